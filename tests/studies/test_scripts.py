"""The scripts of studies/README.md print what stands under them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import studies

TEXT = (Path(studies.__file__).parent / "README.md").read_text(encoding="utf-8")
SECTION = TEXT.split("\n## In Python, in a notebook\n")[1].split("\n## ")[0]
SCRIPTS = re.findall(r"^```python\n(.*?)^```$", SECTION, re.MULTILINE | re.DOTALL)


def promised(script):
    """The comments at its end."""
    return re.findall(r"^# (.*)\n", re.search(r"(^# .*\n)+\Z", script, re.MULTILINE)[0], re.MULTILINE)


def test_every_script_is_short_and_says_what_it_prints():
    """8 to 22 lines besides; CI runs them all, since they are marked as Python."""
    assert len(SCRIPTS) >= 6
    for script in SCRIPTS:
        assert len(promised(script)) >= 1 and 5 <= len(script.splitlines()) - len(promised(script)) <= 22
        compile(script, "README.md", "exec")


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_script_prints_what_it_says(script, tmp_path):
    """The same bits everywhere give the same digits, but for what the processor's mathematics may round otherwise."""
    command = [sys.executable, "-W", "error::UserWarning", "-c", script]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == promised(script)
