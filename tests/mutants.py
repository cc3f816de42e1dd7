"""Mutation run: which changes of a single operator or number do the tests of four modules not notice?

    .venv/bin/pip install -e '.[mutation]'
    .venv/bin/python tests/mutants.py ['analysis.statistics.*' ...]

It works on a copy of the repository in `build/mutation`, and there `mutmut browse` shows what survived. The kernels
run as plain Python, where `@jit` does nothing. mutmut leaves decorated functions alone, so the copy is without
`@jit`; and it knows modules by their files, so those that `kernel.specialise` loads are told their file's name.
"""

import os
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
    os.chdir(COPY)
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    names = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["tool"]["mutmut"]["only_mutate"]
    for name in names:
        if "/kernel/" in name:
            without_jit(Path(name), name.removesuffix(".py").replace("/", "."))
    mutmut = Path(sys.executable).with_name("mutmut")
    subprocess.run([mutmut, "run", "--max-children", "1", *sys.argv[1:]], check=True)

    from mutmut.mutation.data import SourceFileMutationData
    from mutmut.mutation.diff_apply import get_diff_for_mutant
    from mutmut.stats import status_by_exit_code

    for name in names:
        data = SourceFileMutationData(path=Path(name))
        data.load()
        ends = {mutant: status_by_exit_code[code] for mutant, code in data.exit_code_by_key.items()}
        for mutant, end in ends.items():
            if end not in ("killed", "not checked"):
                changed = [
                    line
                    for line in get_diff_for_mutant(mutant, path=data.path).splitlines()[2:]
                    if line[0] in "+-"
                ]
                print(f"\n{mutant}: {end}", *changed, sep="\n")
        counts = ", ".join(f"{count} {end}" for end, count in Counter(ends.values()).most_common())
        print(f"\n{name}: {len(ends)} mutants, {counts}")


if __name__ == "__main__":
    main()
