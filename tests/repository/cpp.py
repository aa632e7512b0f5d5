"""A reader of C++ for the checks: tokens with their lines, and declarations with their template heads, parameters
and bodies.

It knows no types, so that it reads a tree in seconds. It does not expand macros: what looks like a function,
TEST_CASE("…") { … }, is one.
"""

import dataclasses
import re

TOKEN = re.compile(
    r"""(?P<raw>(?:u8|[uUL])?R"(?P<mark>[^()\\\s]{0,16})\(.*?\)(?P=mark)")
      | (?P<string>(?:u8|[uUL])?"(?:[^"\\\n]|\\.)*")
      | (?P<comment>//[^\n]*|/\*.*?\*/)
      | (?P<line>^[ \t]*\#(?:[^\n\\]|\\.)*)
      | (?P<number>\.?\d(?:'?[\w.]|(?<=[eEpP])[+-])*)
      | (?P<character>(?:u8|[uUL])?'(?:[^'\\\n]|\\.)+')
      | (?P<name>[A-Za-z_]\w*)
      | (?P<sign><=>|->\*|\.\.\.|<<=|::|->|\+\+|--|&&|\|\||[-+*/%&|^!=<>]=|<<|[^\s\w])
    """,
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
CLOSING = {"(": ")", "[": "]", "{": "}"}
CONTROL = {"if", "for", "while", "switch", "catch", "else", "do", "try"}


@dataclasses.dataclass(frozen=True)
class Token:
    kind: str  # raw, string, number, character, name or sign
    text: str
    line: int

    def __eq__(self, other):
        return self.text == other

    __hash__ = None


@dataclasses.dataclass
class Parameter:
    """Of a template head."""

    name: str
    default: list  # tokens
    line: int


@dataclasses.dataclass
class Declaration:
    """A function or a type, with its template heads, the outermost first."""

    kind: str  # "function", "type" or "alias"
    name: str
    line: int  # first line after template heads
    heads: list = dataclasses.field(default_factory=list)
    qualifier: list = dataclasses.field(default_factory=list)  # tokens before the name: X<T> of X<T>::f
    result: list = dataclasses.field(default_factory=list)  # tokens of a function before its name
    parameters: list = dataclasses.field(default_factory=list)  # of a function, a list of tokens each
    body: tuple | None = None  # first and last token of a function's body, indices
    end: int = 0  # line of the closing brace
    inside: str = ""  # the class that it lies in


def tokens(text):
    """All tokens but comments and preprocessor lines; `>>` is two signs, so that template heads close."""
    found, line, at = [], 1, 0
    for match in TOKEN.finditer(text):
        line += text.count("\n", at, match.start())
        at = match.start()
        kind = match.lastgroup if match.lastgroup != "mark" else "raw"
        if kind not in ("comment", "line"):
            found.append(Token(kind, match.group(), line))
    return found


class Reader:
    def __init__(self, text):
        self.tokens = tokens(text)
        self.partner = {}  # index of an opening sign → its closing one
        self.declarations = []
        open_signs = []
        for k, token in enumerate(self.tokens):
            if token.kind != "sign":
                continue
            if token.text in CLOSING:
                open_signs.append(k)
            elif open_signs and token.text == CLOSING[self.tokens[open_signs[-1]].text]:
                self.partner[open_signs.pop()] = k
        self._scope(0, len(self.tokens), "")

    def _is(self, k, *texts):
        return k < len(self.tokens) and self.tokens[k].text in texts and self.tokens[k].kind in ("name", "sign")

    def _over(self, k):
        """Behind the bracket that opens at k."""
        return self.partner.get(k, k) + 1

    def over_angles(self, k):
        """Behind the `<…>` that opens at k, or k + 1 where none closes before the statement ends."""
        depth, at = 0, k
        while at < len(self.tokens):
            text = self.tokens[at].text if self.tokens[at].kind == "sign" else ""
            if text == "<":
                depth += 1
            elif text == ">":
                depth -= 1
                if depth == 0:
                    return at + 1
            elif text in CLOSING:
                at = self._over(at)
                continue
            elif text in (";", ")", "]", "}"):
                break
            at += 1
        return k + 1

    def split(self, begin, end):
        """Tokens of a list, split at its commas outside of brackets and angles."""
        parts, start, at = [], begin, begin
        while at < end:
            if self._is(at, "(", "[", "{"):
                at = self._over(at)
            elif self._is(at, "<") and at > begin and self.tokens[at - 1].kind == "name":
                at = self.over_angles(at)
            elif self._is(at, ","):
                parts.append(self.tokens[start:at])
                start = at = at + 1
            else:
                at += 1
        return parts + [self.tokens[start:end]] if end > start else parts

    def _constraint(self, k):
        """Behind a requires clause, which begins at k."""
        at = k + 1
        while at < len(self.tokens):
            while self._is(at, "!"):
                at += 1
            if self._is(at, "("):
                at = self._over(at)
            elif self._is(at, "requires"):
                at += 1
                if self._is(at, "("):
                    at = self._over(at)
                at = self._over(at)
            else:
                at = self._name(at)
            if not self._is(at, "&&", "||"):
                return at
            at += 1
        return at

    def _name(self, k):
        """Behind a qualified name with its template arguments."""
        at = k + 1 if self._is(k, "::") else k
        while at < len(self.tokens) and self.tokens[at].kind in ("name", "number"):
            at += 1
            if self._is(at, "<"):
                at = self.over_angles(at)
            if not self._is(at, "::"):
                break
            at += 1
        return max(at, k + 1)

    def _head(self, k):
        """Parameters of the template head that begins at k, and the index behind it."""
        end = self.over_angles(k + 1)
        found = []
        for part in self.split(k + 2, end - 1):
            equal = next((n for n, t in enumerate(part) if t == "=" and t.kind == "sign"), len(part))
            named = [t for t in part[:equal] if t.kind == "name"]
            angles = [n for n, t in enumerate(part[:equal]) if t == ">"]
            last = part[equal - 1] if equal else None
            is_named = (
                last is not None
                and last.kind == "name"
                and last.text not in ("class", "typename", "auto")
                and (equal > 1 or len(named) > 1)
                and (not angles or angles[-1] < equal - 1)
            )
            found.append(Parameter(last.text if is_named else "", part[equal + 1 :], part[0].line))
        if self._is(end, "requires"):
            end = self._constraint(end)
        return found, end

    def _scope(self, begin, end, inside):
        at = begin
        while at < end:
            at = max(at + 1, self._declaration(at, end, inside))

    def _declaration(self, begin, end, inside):
        at, heads = begin, []
        if self._is(at, ";"):
            return at + 1
        if self._is(at, "public", "private", "protected") and self._is(at + 1, ":"):
            return at + 2
        while self._is(at, "template") and self._is(at + 1, "<"):
            head, at = self._head(at)
            heads.append(head)
        if self._is(at, "inline") and self._is(at + 1, "namespace"):
            at += 1
        if self._is(at, "namespace") or (
            self._is(at, "extern") and at + 1 < end and self.tokens[at + 1].kind == "string"
        ):
            while at < end and not self._is(at, "{", ";"):
                at += 1
            if self._is(at, "{"):
                self._scope(at + 1, self.partner.get(at, end), "")
                return self._over(at)
            return at + 1
        if self._is(at, "using") and heads and at + 1 < end:
            self.declarations.append(Declaration("alias", self.tokens[at + 1].text, self.tokens[at].line, heads))
        if self._is(at, "using", "typedef", "static_assert", "concept", "enum"):
            return self._to_semicolon(at, end)
        if self._is(at, "class", "struct", "union"):
            found = self._type(at, end, heads)
            if found:
                return found
        return self._function(at, end, heads, inside)

    def _to_semicolon(self, at, end):
        while at < end and not self._is(at, ";"):
            at = self._over(at) if self._is(at, "(", "[", "{") else at + 1
        return at + 1

    def _type(self, begin, end, heads):
        """Behind the class that begins here, or 0 where this is no class of its own (a function that returns one)."""
        at, name, bases = begin + 1, "", False
        while at < end:
            if self._is(at, "[") or (self._is(at, "alignas")):
                at = self._over(at if self._is(at, "[") else at + 1)
            elif self._is(at, "<"):
                at = self.over_angles(at)
            elif self._is(at, ":"):
                bases, at = True, at + 1
            elif self._is(at, "(") and bases:
                at = self._over(at)
            elif self._is(at, "{"):
                self.declarations.append(
                    Declaration(
                        "type", name, self.tokens[begin].line, heads, end=self.tokens[self.partner.get(at, at)].line
                    )
                )
                self._scope(at + 1, self.partner.get(at, end), name)
                return self._to_semicolon(self._over(at), end)
            elif self._is(at, ";"):
                self.declarations.append(Declaration("type", name, self.tokens[begin].line, heads))
                return at + 1
            elif self._is(at, "(", "=", "&", "*"):
                return 0
            else:
                if not bases and self.tokens[at].kind == "name" and self.tokens[at].text != "final":
                    name = self.tokens[at].text
                at += 1
        return 0

    def _function(self, begin, end, heads, inside):
        """A function or anything else that ends at a semicolon or with a body; the index behind it."""
        at = begin
        while at < end:
            if self._is(at, "operator"):
                name_at = at
                at += 1
                if self._is(at, "(") and self._is(at + 1, ")"):
                    at += 2
                while at < end and not self._is(at, "("):
                    at = (
                        self.over_angles(at)
                        if self._is(at, "<")
                        and self.tokens[at - 1].kind == "name"
                        and self.tokens[at - 1].text != "operator"
                        else at + 1
                    )
                return self._parameters(begin, name_at, at, end, heads, inside)
            if self._is(at, "decltype", "alignas", "explicit", "noexcept", "__attribute__") and self._is(at + 1, "("):
                at = self._over(at + 1)
            elif self._is(at, "["):
                at = self._over(at)
            elif self._is(at, "<") and at > begin and self.tokens[at - 1].kind == "name":
                at = self.over_angles(at)
            elif self._is(at, "("):
                name_at = at - 1
                if self._is(name_at, ">"):  # of a specialisation
                    while name_at > begin and not (self._is(name_at, "<") and self.over_angles(name_at) == at):
                        name_at -= 1
                    name_at -= 1
                return self._parameters(begin, name_at, at, end, heads, inside)
            elif self._is(at, "{", "="):
                return self._to_semicolon(at, end)
            elif self._is(at, ";"):
                return at + 1
            else:
                at += 1
        return at

    def _parameters(self, begin, name_at, at, end, heads, inside):
        if not self._is(at, "(") or name_at < begin:
            return self._to_semicolon(at, end)
        close = self.partner.get(at, end)
        name = (
            "".join(t.text for t in self.tokens[name_at:at] if name_at == at - 1 or self._is(name_at, "operator"))
            or self.tokens[name_at].text
        )
        if self._is(name_at - 1, "~"):
            name, name_at = "~" + name, name_at - 1
        start = self._qualifier(begin, name_at)
        function = Declaration(
            "function",
            name,
            self.tokens[begin].line,
            heads,
            self.tokens[start:name_at],
            self.tokens[begin:start],
            [p for p in self.split(at + 1, close) if [t.text for t in p] != ["void"]],
            inside=inside,
        )
        at = close + 1
        while at < end:
            if self._is(at, "noexcept", "__attribute__") and self._is(at + 1, "("):
                at = self._over(at + 1)
            elif self._is(at, "requires"):
                at = self._constraint(at)
            elif self._is(at, "->"):
                at += 1
                while at < end and not self._is(at, "{", ";", "requires", "="):
                    at = (
                        self._over(at)
                        if self._is(at, "(", "[")
                        else self.over_angles(at) if self._is(at, "<") else at + 1
                    )
            elif self._is(at, ":"):
                at = self._initialisers(at + 1, end)
            elif self._is(at, "{"):
                function.body, function.end = (at, self.partner.get(at, end)), self.tokens[
                    min(self.partner.get(at, end), len(self.tokens) - 1)
                ].line
                self.declarations.append(function)
                return self._over(at)
            elif self._is(at, ";", "="):
                self.declarations.append(function)
                return self._to_semicolon(at, end)
            elif self._is(at, "const", "volatile", "&", "&&", "override", "final", "noexcept", "try", "mutable"):
                at += 1
            else:  # no function: a variable with parentheses, a macro
                return self._to_semicolon(at, end) if not self._is(at, "}") else at + 1
        return at

    def _qualifier(self, begin, name_at):
        """Where the qualified name starts whose last part is at name_at."""
        at = name_at
        while at - 1 > begin and self._is(at - 1, "::"):
            at -= 2
            if self._is(at, ">"):
                while at > begin and not (
                    self._is(at, "<") and self.over_angles(at) > at + 1 and self._is(self.over_angles(at), "::")
                ):
                    at -= 1
                at -= 1
        return at

    def _initialisers(self, at, end):
        """Index of the body behind a constructor's initialisers."""
        while at < end:
            at = self._name(at)
            if self._is(at, "(", "{"):
                at = self._over(at)
            if self._is(at, "..."):
                at += 1
            if not self._is(at, ","):
                return at
            at += 1
        return at

    # ---- inside bodies

    def lambdas(self, begin, end):
        """Line and parameters of each lambda."""
        for k in range(begin, end):
            if not self._is(k, "[") or k not in self.partner:
                continue
            before = self.tokens[k - 1]
            if (
                (before.kind in ("name", "number") and before.text not in ("return", "co_return", "else", "do", "case"))
                or before.text in (")", "]", ">")
                or before.kind in ("string", "raw")
            ):
                continue
            at = self._over(k)
            if self._is(at, "<"):
                at = self.over_angles(at)
            if self._is(at, "("):
                yield self.tokens[k].line, self.split(at + 1, self.partner.get(at, end))

    def statements(self, begin, end):
        """Each statement between two indices that ends at a semicolon, those of nested blocks too: its tokens without
        what stands in brackets."""
        yield from self._statements(begin, end, True)

    def _statements(self, begin, end, is_block):
        statement, at = [], begin
        while at < end:
            if self._is(at, "(", "[", "{"):
                braces = self._is(at, "{")
                close = self.partner.get(at, end)
                yield from self._statements(at + 1, close, braces)
                statement += [self.tokens[at], self.tokens[min(close, end - 1)]]
                at = close + 1
                goes_on = (
                    at < end
                    and self.tokens[at].kind == "sign"
                    and not self._is(at, "{", "}", "++", "--", "*", "~", "::")
                )
                if braces and not goes_on:
                    statement = []
            elif self._is(at, ";"):
                if is_block and statement:
                    yield statement
                statement, at = [], at + 1
            else:
                statement.append(self.tokens[at])
                at += 1


def read(path):
    return Reader(path.read_text(encoding="utf-8"))
