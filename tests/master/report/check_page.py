"""Checks pages of `cotwin report`: python3 check_page.py PAGE.html…; prints what is wrong, exit code 1 if anything is."""
import base64
import hashlib
import html.parser
import re
import sys

VOID = {"meta", "br", "hr", "img", "link", "input"}
KNOWN = {"html", "head", "meta", "title", "style", "body", "h1", "h2", "h3", "h4", "nav", "ul", "li", "a", "main", "p", "div", "table",
         "caption", "thead", "tbody", "tr", "th", "td", "code", "figure", "figcaption", "footer", "svg", "path", "rect", "polygon", "text"}
ATTRIBUTES = {"lang", "charset", "http-equiv", "content", "name", "class", "id", "href", "aria-label", "aria-hidden", "role", "viewbox",
              "d", "points", "transform", "font-size", "text-anchor", "x", "y", "width", "height", "preserveaspectratio"}


class Checker(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.wrong, self.ids, self.links, self.csp, self.style = [], [], [], [], "", ""

    def handle_starttag(self, tag, attributes):
        if tag not in KNOWN:
            self.wrong.append(f"element <{tag}>")
        for name, value in attributes:
            if name not in ATTRIBUTES:
                self.wrong.append(f"attribute {name}={value!r} of <{tag}>")
            if name == "id":
                self.ids.append(value)
            if name == "href":
                self.links.append(value)
            if name in ("d", "points") and re.search(r"nan|inf", value, re.I):
                self.wrong.append(f"{name}={value[:40]!r}")
        given = dict(attributes)
        if given.get("http-equiv") == "Content-Security-Policy":
            self.csp = given["content"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if not self.open or self.open[-1] != tag:
            self.wrong.append(f"</{tag}> at line {self.getpos()[0]} while {self.open[-3:]} are open")
        else:
            self.open.pop()

    def handle_data(self, data):
        if self.open and self.open[-1] == "style":
            self.style += data

    def handle_decl(self, declaration):
        if declaration != "DOCTYPE html":
            self.wrong.append(f"<!{declaration}>")

    def handle_comment(self, data):
        self.wrong.append("a comment")


def check(file):
    text = open(file, "rb").read().decode("utf-8")
    checker = Checker()
    checker.feed(text)
    checker.close()
    wrong = checker.wrong
    if checker.open:
        wrong.append(f"not closed: {checker.open}")
    if len(set(checker.ids)) != len(checker.ids):
        wrong.append("an id occurs twice")
    wrong += [f"link to {link!r}" for link in checker.links if not (link.startswith("#") and link[1:] in checker.ids)]
    digest = base64.b64encode(hashlib.sha256(checker.style.encode()).digest()).decode()
    expected = f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    if checker.csp != expected:
        wrong.append(f"Content-Security-Policy {checker.csp!r}, expected {expected!r}")
    if re.search(r"url\(|@import|expression", checker.style):
        wrong.append("the style sheet loads something")
    return wrong


failed = False
for page in sys.argv[1:]:
    for problem in check(page):
        failed = True
        print(f"{page}: {problem}")
sys.exit(1 if failed else 0)
