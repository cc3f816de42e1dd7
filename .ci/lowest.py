"""Print the lowest version that pyproject.toml allows of each dependency, as pip takes it.

CI tries these, as well as the newest.
"""

import re
import tomllib

with open("pyproject.toml", "rb") as file:
    for requirement in tomllib.load(file)["project"]["dependencies"]:
        name, floor = re.fullmatch(r"([\w-]+)>=([\w.]+)", requirement).groups()
        print(f"{name}=={floor}")
