"""Print the code blocks of one language in some texts, in order: CI runs what the reader is told to run."""

import re
import sys

language, *paths = sys.argv[1:]
for path in paths:
    with open(path, encoding="utf-8") as file:
        print("\n".join(re.findall(rf"^```{language}\n(.*?)^```$", file.read(), re.MULTILINE | re.DOTALL)))
