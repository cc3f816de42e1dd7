"""Mutation run: which changes of a single operator or number do the tests of four modules not notice?

    .venv/bin/pip install -e '.[mutation]'
    .venv/bin/python tests/mutants.py ['analysis.statistics.*' ...]

It works on a copy of the repository in `build/mutation`, and there `mutmut browse` shows what survived. The kernels
run as plain Python, where `@jit` does nothing. mutmut leaves decorated functions alone, so the copy is without
`@jit`; and it knows modules by their files, so those that `kernel.specialise` loads are told their file's name.
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPY = ROOT / "build" / "mutation"


def without_jit(path, name):
    """Take `@jit` from the functions of a module, and give it the name of its file."""
    head, first, rest = path.read_text(encoding="utf-8").partition("@jit\n")
    path.write_text(f'{head}__name__ = "{name}"\n\n\n{first}{rest}'.replace("@jit\n", ""), encoding="utf-8")


def main():
    shutil.rmtree(COPY, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        (COPY / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, COPY / name)
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]
    modules = {name: name.removesuffix(".py").replace("/", ".") for name in config["only_mutate"]}
    for name, module in modules.items():
        if ".kernel." in module:
            without_jit(COPY / name, module)
    mutmut = Path(sys.executable).with_name("mutmut")
    here = {"cwd": COPY, "env": os.environ | {"NUMBA_DISABLE_JIT": "1"}, "check": True}
    subprocess.run([mutmut, "run", "--max-children", "1", *sys.argv[1:]], **here)
    told = subprocess.run([mutmut, "results", "--all", "true"], capture_output=True, text=True, **here).stdout
    for module in modules.values():
        ends = re.findall(rf"^ *({re.escape(module)}\.\S+): (.+)$", told, re.MULTILINE)
        counts = Counter(end for _, end in ends)
        print(f"\n{module}: {len(ends)} mutants: {', '.join(f'{n} {end}' for end, n in counts.most_common())}")
        for name, end in ends:
            if end not in ("killed", "timeout", "not checked"):
                print(end, subprocess.run([mutmut, "show", name], capture_output=True, text=True, **here).stdout)


if __name__ == "__main__":
    main()
