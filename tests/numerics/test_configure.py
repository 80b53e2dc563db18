"""One call before JAX begins; each in a process of its own, since the settings hold for all of it.
"""

import os
import subprocess
import sys

import pytest

#: What was chosen, in one line.
SHOW = """
import jax, os
print(jax.config.jax_enable_x64, "multi_output_fusion" in os.environ.get("XLA_FLAGS", ""),
      jax.config.jax_compilation_cache_dir, jax.numpy.ones(1).dtype)
"""

def shown(code, tmp_path, **environment):
    """The last line, as words, and what was said on standard error."""
    kept = ("XLA_FLAGS", "JAX_ENABLE_X64", "JAX_COMPILATION_CACHE_DIR")
    clean = {name: value for name, value in os.environ.items() if name not in kept}
    clean |= {"XDG_CACHE_HOME": str(tmp_path)} | environment
    command = [sys.executable, "-c", code + SHOW]
    done = subprocess.run(command, env=clean, capture_output=True, text=True, check=True)
    return done.stdout.split(), done.stderr


def test_importing_the_package_changes_nothing(tmp_path):
    words, said = shown("import kneejax, kneejax.inference", tmp_path)
    assert words == ["False", "False", "None", "float32"] and not said


@pytest.mark.parametrize("times", [1, 2])
def test_one_call_does_all_and_may_be_repeated(times, tmp_path):
    code = "import kneejax\n" + "kneejax.configure()\n" * times
    words, said = shown(code, tmp_path)
    assert words == ["True", "True", str(tmp_path / "kneejax"), "float64"] and not said


def test_what_a_person_has_chosen_stays(tmp_path):
    folder, flags = str(tmp_path / "mine"), "--xla_cpu_enable_fast_math=false"
    mine = {"JAX_COMPILATION_CACHE_DIR": folder, "XLA_FLAGS": flags}
    code = "import kneejax, os\nkneejax.configure()\nassert 'fast_math' in os.environ['XLA_FLAGS']"
    words, said = shown(code, tmp_path, **mine)
    assert words == ["True", "True", folder, "float64"] and not said


def test_a_folder_of_no_name_is_none(tmp_path):
    """Programs would be written wherever a command is called."""
    words, _ = shown("import kneejax\nkneejax.configure()", tmp_path, JAX_COMPILATION_CACHE_DIR="")
    assert words[2] == str(tmp_path / "kneejax")


def test_too_late_is_said_and_float64_holds_all_the_same(tmp_path):
    code = "import jax, kneejax\njax.numpy.ones(3)\nkneejax.configure()"
    words, said = shown(code, tmp_path)
    assert "RuntimeWarning: kneejax.configure() comes too late: JAX has begun to compute" in said
    assert "<string>:3" in said
    assert words == ["True", "False", str(tmp_path / "kneejax"), "float64"]


def test_the_command_line_begins_with_it(monkeypatch):
    import kneejax.numerics
    from kneejax.cli._main import prepare_jax

    called = []
    monkeypatch.setattr(kneejax.numerics, "configure", lambda: called.append("configure"))
    prepare_jax()
    assert called == ["configure"]
