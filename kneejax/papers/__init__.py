"""Claims of five papers, judged: one file a paper, whose claims stand in the YAML file beside it.

Nothing in the package imports this room but the commands `reproduce` and `sensitivity --knees`.
"""
