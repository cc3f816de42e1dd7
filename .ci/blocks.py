"""Print the README's code blocks of one language, in order: what CI runs is what the reader is told to run."""

import re
import sys

path, language = sys.argv[1:]
with open(path, encoding="utf-8") as file:
    print("\n".join(re.findall(rf"^```{language}\n(.*?)^```$", file.read(), re.MULTILINE | re.DOTALL)))
