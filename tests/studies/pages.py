"""Reading a report as a browser would, with its own eyes: nesting, ids, tables, text, what it loads."""

import re
from html.parser import HTMLParser

VOID = {"meta", "link", "br", "img"}
LOADING = {"src", "srcset", "data", "poster", "background", "action", "srcdoc", "xlink:href"}


def masked(text):
    """A report without what varies when the same run is repeated."""
    return re.sub(r"(<(\w+)[^<>]* data-varies>).*?(</\2>)", r"\1\3", text, flags=re.DOTALL)


class Page(HTMLParser):
    """What is in a page."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.names, self.links, self.loads, self.words = [], [], [], [], [], []
        self.tables, self.labels, self.scopes = [], [], []
        self.feed(text)
        self.close()
        assert self.open == [], self.open

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        given = dict(attrs)
        assert len(given) == len(attrs), (tag, attrs)
        self.names.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.labels += [given["aria-label"]] if "aria-label" in given else []
        if tag == "a":
            self.links.append(given["href"])
        for name, value in given.items():
            if name in LOADING or (tag == "link" and name == "href"):
                self.loads.append(value)
            assert not name.startswith("on"), (tag, name)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("th", "td"):
            self.tables[-1][-1].append("")
            self.scopes.append((tag, given.get("scope")))

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, (tag, self.open)

    def handle_data(self, data):
        if self.open and self.open[-1] in ("style", "script"):
            self.loads += re.findall(r"@import\s+\S+|url\([^)]*\)|https?://\S+|fetch\([^)]*\)", data)
            return
        if self.open and self.open[-1] in ("th", "td"):
            self.tables[-1][-1][-1] += data
        self.words.append(data)

    @property
    def text(self):
        """Everything that is read, blanks made one."""
        return " ".join(" ".join(self.words).split())
