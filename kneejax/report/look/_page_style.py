"""How the report looks on a screen, on a phone and on paper.

A table or figure wider than the screen scrolls in its own box (`.wide`), with a shadow at the side
where it goes on: the two white layers move with it and cover the shadows at its ends. A figure's
white multiplies with what lies beneath, so that its shadows show. On a phone a figure keeps a
width at which its smallest letters can be read, and a line above says that it scrolls.
"""

CSS = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: #1a1a1a; font: 16px/1.5 system-ui, -apple-system,
  "Segoe UI", Roboto, "Liberation Sans", Arial, sans-serif; -webkit-text-size-adjust: 100%; }
main { max-width: 70rem; margin: 0 auto; padding: 1.5rem 1.25rem 4rem; }
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0 0 .25rem; text-wrap: balance; }
h2 { font-size: 1.25rem; margin: 2.25rem 0 .5rem; padding-top: .6rem;
  border-top: 1px solid #d5d9dd; }
h3 { font-size: 1rem; margin: 1.25rem 0 .25rem; }
p { margin: .5rem 0; max-width: 46rem; }
.under { color: #555; margin-top: 0; }
.small, figcaption { color: #4a4a4a; font-size: .875rem; max-width: 46rem; }
.badge { display: inline-block; padding: 0 .55rem; border-radius: .25rem; color: #fff; }
.badge.good { background: #00704f; }
.badge.doubtful { background: #a34700; }
.badge.failed { background: #b00020; }
dl { display: flex; flex-wrap: wrap; gap: .5rem 2rem; margin: 1rem 0 0; }
dt { color: #555; font-size: .8125rem; }
dd { margin: 0; font-size: 1.125rem; font-weight: 600; font-variant-numeric: tabular-nums; }
.warnings { border-left: .3rem solid #d55e00; background: #fff6ef; padding: .6rem 1rem;
  margin: 1.25rem 0 0; }
.warnings h2 { border: 0; padding: 0; margin: 0; font-size: 1rem; }
.warnings ul { margin: .25rem 0 0; padding-left: 1.2rem; }
.warnings li { margin: .2rem 0; overflow-wrap: anywhere; }
.wide { overflow-x: auto; background:
  linear-gradient(to right, #fff 40%, #fff0) left / 3rem 100% no-repeat local,
  linear-gradient(to left, #fff 40%, #fff0) right / 3rem 100% no-repeat local,
  linear-gradient(to right, #0004, #0000) left / 1rem 100% no-repeat scroll,
  linear-gradient(to left, #0004, #0000) right / 1rem 100% no-repeat scroll; }
table { border-collapse: collapse; font-size: .875rem; margin: .5rem 0;
  font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: baseline; padding: .25rem .7rem .25rem 0; }
table:has(th:nth-child(11)) { font-size: .8125rem; }
table:has(th:nth-child(11)) :is(th, td) { padding-right: .5rem; }
th:last-child, td:last-child { padding-right: 0; }
th { border-bottom: 1.5px solid #1a1a1a; vertical-align: bottom; line-height: 1.25;
  font-weight: 600; }
td { border-bottom: 1px solid #e6e8ea; }
td:not(:last-child), td.n { white-space: nowrap; }
td:last-child:not(.n) { overflow-wrap: anywhere; min-width: 9rem; }
.n { text-align: right; }
figure { margin: 1rem 0; }
figure svg { display: block; width: 100%; height: auto; mix-blend-mode: multiply; }
@media screen and (max-width: 40rem) {
  figure svg { width: auto; min-width: min(36rem, 100% + 20rem); }
  figure .wide::before, .wide:has(th:nth-child(6))::before { content: "scroll sideways for more";
    position: sticky; left: 0; display: block; width: max-content; color: #555;
    font-size: .75rem; }
}
@media print {
  body { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  .wide { overflow: visible; background: none; }
  figure, tr, .warnings { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  table { font-size: 8pt; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
"""
