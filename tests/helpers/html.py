"""A page's elements, as a browser's parser cuts the page."""

from html.parser import HTMLParser

VOID = {"meta", "link", "img", "input", "br"}
Attributes = dict[str, str | None]


class Elements(HTMLParser):
    """All with their attributes and texts. Raises AssertionError where tags do not nest."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.all: list[tuple[str, Attributes, list[str]]] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.all.append((tag, dict(attrs), []))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.all.append((tag, dict(attrs), []))

    def handle_data(self, data: str) -> None:
        if self.all:
            self.all[-1][2].append(data)

    def of(self, name: str) -> list[tuple[Attributes, str]]:
        """Attributes and text of each element of this kind."""
        return [(attrs, "".join(texts)) for tag, attrs, texts in self.all if tag == name]

    def text_of(self, name: str) -> str:
        """Of the element with this id."""
        (texts,) = (texts for _, attrs, texts in self.all if attrs.get("id") == name)
        return "".join(texts)
