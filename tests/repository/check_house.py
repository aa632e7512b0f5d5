"""Checks of the house: what keeps the tree readable and no compiler checks.

Prints each violation as `path:line: what (value, limit)`.

usage: check_house.py ROOT [--count]
ROOT is the repository's folder. --count prints how many violations there are of each kind instead.
"""

import argparse
import collections
import pathlib
import re
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.dont_write_bytecode = True
import check_includes  # noqa: E402
import cpp  # noqa: E402

CODE_FOLDERS = ["include", "examples", "tests", "benchmarks"]  # single_include/ is made of them
TEXTS = ["docs", "README.md", "CONTRIBUTING.md"]  # CHANGELOG.md keeps what its old sections say
TEXT_SUFFIXES = {".hpp", ".cpp", ".md", ".py", ".js", ".css", ".html", ".txt", ".in", ".cmake", ""}
COLUMNS = 120  # of a line
LINES = 60  # of a function, from its first line (template heads apart) to its closing brace; of a test case, too
PARAMETERS = 6  # of a function, a constructor or a lambda
HEADERS = 14  # of a room
ROOM_EXCEPTIONS = {}  # room: (limit, why)
UMBRELLA = ""  # headers that lie in include/lumo itself

# Words that say in a home-made way what the field has a word for, and idioms of another language:
# pattern, what to write, files that it is about.
ALL, CODE = re.compile(""), re.compile(r"\.(hpp|cpp)$")
WORDS = [
    (re.compile(r"\btold\b|\btells\b|\b[Tt]ell(?:ing)? of\b"), "reported, reports, distinguishes or states", ALL),
    (re.compile(r"\b[Dd]ear(?:er|est|ly)?\b"), "expensive", ALL),
    (re.compile(r"\bnothing where\b", re.IGNORECASE), "nullopt if", ALL),
    (re.compile(r"firmness", re.IGNORECASE), "penalty stiffness scale", ALL),
    (re.compile(r"touch_down|\btouch(?:es|ed)? down\b", re.IGNORECASE), "first load", ALL),
    (re.compile(r"\bborder_?\s*\("), "Schur complement", CODE),
    (re.compile(r"carrier_exchange|\bCarrierExchange\b"), "radiosity", ALL),
    (re.compile(r"exit_gather|\bExitGather\b"), "next-event gather", ALL),
    (re.compile(r"\bLanes\b|\bvertex_lanes\b|\bcore/lanes\b"), "SIMD pack", ALL),
    (re.compile(r"\bDraws\b(?! (?:of|are|come)\b)|\blab/draws\b"), "random stream", ALL),
    (re.compile(r"\b\w*[Rr]eadings\w*"), "assumptions", ALL),
]
ALLOWED_WORDS = re.compile(
    r'[Ss]tudy[ _/]?[Rr]eadings\w*|"readings"|--store readings\.db|readings\.db'
)  # the command keeps its name, and so do its type and its files
WORD_LISTS = {"check_house.py", "test_checks.py"}  # which have to name the words

# Paths that pages name: headers and sources by any name, all else below the folders of the tree.
PAGES = ["docs", "benchmarks", "README.md", "CONTRIBUTING.md"]
FOLDERS = ["include", "examples", "tests", "benchmarks", "docs", "cmake", "single_include"]
NAMED_PATH = re.compile(
    rf"(?<![\w/.<…-])((?:[\w-]+/)*[\w-]+\.(?:hpp|cpp)|(?:{'|'.join(FOLDERS)})/[\w./-]*\w)(?![\w<*…(/]|\.[\w*])"
)
BASES = ["", "include", "include/lumo", "examples", "examples/lumo", "tests"]  # from which a path may start
MAP = re.compile(r"^```\n(include/lumo/\n.*?)^```$", re.MULTILINE | re.DOTALL)  # of the tree, in CONTRIBUTING.md
MAP_LINES = 30

ASSIGNMENTS = {"=", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^=", "<<=", "++", "--"}


class Tree:
    """Files of a repository, each read once."""

    def __init__(self, root):
        self.root = pathlib.Path(root)
        self.code = {
            self.name(p): p
            for folder in CODE_FOLDERS
            for p in sorted((self.root / folder).rglob("*"))
            if p.suffix in (".hpp", ".cpp") and p.is_file()
        }
        self.texts = {name: path.read_text(encoding="utf-8") for name, path in self.code.items()}
        self.readers = {name: cpp.Reader(text) for name, text in self.texts.items()}

    def name(self, path):
        return path.relative_to(self.root).as_posix()

    def prose(self):
        """All texts whose words count: code, scripts and pages."""
        for top in CODE_FOLDERS + TEXTS:
            start = self.root / top
            for path in sorted(start.rglob("*")) if start.is_dir() else [start]:
                if path.is_file() and path.suffix in TEXT_SUFFIXES and path.name not in WORD_LISTS:
                    yield self.name(path), path.read_text(encoding="utf-8", errors="replace")


def long_lines(tree):
    for name, text in tree.texts.items():
        for number, line in enumerate(text.splitlines(), 1):
            if len(line) > COLUMNS:
                yield f"{name}:{number}: line is too long ({len(line)} columns, {COLUMNS})"


def functions(tree):
    for name, reader in tree.readers.items():
        for d in reader.declarations:
            if d.body and d.end - d.line + 1 > LINES:
                yield f"{name}:{d.line}: function {d.name} is too long ({d.end - d.line + 1} lines, {LINES})"


def parameters(tree):
    for name, reader in tree.readers.items():
        for d in reader.declarations:
            if len(d.parameters) > PARAMETERS:
                count = f"{len(d.parameters)} parameters, {PARAMETERS}"
                yield f"{name}:{d.line}: function {d.name} takes too much ({count})"
        for line, taken in reader.lambdas(1, len(reader.tokens)):
            if len(taken) > PARAMETERS:
                yield f"{name}:{line}: a lambda takes too much ({len(taken)} parameters, {PARAMETERS})"


def rooms(tree):
    root = tree.root / "include" / "lumo"
    counts = collections.Counter(p.parent.relative_to(root).as_posix() for p in root.rglob("*.hpp"))
    if not counts:
        yield "include/lumo:1: no headers found"
    for room, count in sorted(counts.items()):
        limit, _ = ROOM_EXCEPTIONS.get(room, (HEADERS, ""))
        if count > limit:
            yield f"include/lumo/{room}:1: room has too much in it ({count} headers, {limit})"
        if room != "." and not room.endswith("/detail") and room not in check_includes.ALLOWED:
            yield f"include/lumo/{room}:1: check_includes.py knows no such room"


def details(tree):
    for name, reader in tree.readers.items():
        if name.startswith("include/"):
            continue
        t = reader.tokens
        for k, token in enumerate(t):
            if token == "detail" and token.kind == "name":
                outer = t[k - 2].text if k >= 2 and t[k - 1] == "::" else ""
                if outer in ("lumo", "sense") or (not outer and k + 1 < len(t) and t[k + 1] == "::"):
                    yield f"{name}:{token.line}: detail:: of the library is used from outside"
        for number, line in enumerate(tree.texts[name].splitlines(), 1):
            if re.match(r'\s*#\s*include\s*"lumo/.*\bdetail/', line):
                yield f"{name}:{number}: a header of a detail/ folder is included from outside"


def words(tree):
    for name, text in tree.prose():
        for number, line in enumerate(text.splitlines(), 1):
            rest = ALLOWED_WORDS.sub("", line)
            for pattern, better, files in WORDS:
                if files.search(name):
                    for match in pattern.finditer(rest):
                        yield f"{name}:{number}: word '{match.group(0).strip('(')}': write {better}"


# ---- pages that are true to the tree


def pages(tree):
    """Name and text of each page."""
    for top in PAGES:
        start = tree.root / top
        for path in sorted(start.rglob("*.md")) if start.is_dir() else [start]:
            if path.is_file():
                yield tree.name(path), path.read_text(encoding="utf-8")


def dead_paths(tree):
    names = {name.rsplit("/", 1)[-1] for name in tree.code}
    for page, text in pages(tree):
        bases = [tree.root / base for base in BASES] + [(tree.root / page).parent]
        for number, line in enumerate(text.splitlines(), 1):
            for path in NAMED_PATH.findall(line):
                if not (path in names or any((base / path).exists() for base in bases)):
                    yield f"{page}:{number}: no such file: {path}"


def rooms_of_map(text):
    """Rooms that the map names, each before its `/` and behind two spaces: at the start of a line that is indented by
    two, or else inside the room of the last such line."""
    found, above = [], ""
    for line in text.splitlines()[1:]:
        if not line.startswith(" "):
            break
        for match in re.finditer(r"(?<=  )([a-z_]+(?:/[a-z_]+)*)/(?=\s)", line):
            if match.start() == 2:
                above = match[1]
            found.append(above if match.start() == 2 else f"{above}/{match[1]}")
    return found


def map_of_tree(tree):
    page = tree.root / "CONTRIBUTING.md"
    text = page.read_text(encoding="utf-8")
    found = MAP.search(text)
    if not found:
        yield "CONTRIBUTING.md:1: has no map of include/lumo/"
        return
    line = text[: found.start()].count("\n") + 2
    lines = found[1].count("\n")
    if lines > MAP_LINES:
        yield f"CONTRIBUTING.md:{line}: map is too long ({lines} lines, {MAP_LINES})"
    root = tree.root / "include" / "lumo"
    there = {p.parent.relative_to(root).as_posix() for p in root.rglob("*.hpp")} - {"."}
    there = {room for room in there if not room.endswith("/detail")}
    named = rooms_of_map(found[1])
    for room in sorted(there - set(named)):
        yield f"CONTRIBUTING.md:{line}: map lacks the room {room}"
    for room in sorted(set(named)):
        if room not in there and not any(r.startswith(room + "/") for r in there):
            yield f"CONTRIBUTING.md:{line}: map names a room that is not there: {room}"


# ---- chains of assignments


def without_control(statement):
    """The statement behind `if (…)`, `else`, `case x:` and their likes."""
    while statement and statement[0].text in ("if", "while", "for", "switch", "else", "case", "default", "do"):
        if statement[0].text in ("else", "do"):
            statement = statement[1:]
        elif statement[0].text in ("case", "default"):
            colon = next((k for k, t in enumerate(statement) if t == ":"), len(statement))
            statement = statement[colon + 1 :]
        else:
            close = next((k for k, t in enumerate(statement) if t == ")"), len(statement))
            statement = statement[close + 1 :]
    return statement


def is_declaration(part):
    """Does the first of some parts declare its variable: has its target a type before the name?"""
    target = part[: next((k for k, t in enumerate(part) if t.kind == "sign" and t.text in ASSIGNMENTS), len(part))]
    if target and target[0].text in ("using", "typedef", "auto", "const", "constexpr", "static"):
        return True
    for k in range(1, len(target)):
        before = target[k - 1]
        if target[k].kind == "name" and (before.kind == "name" or (k > 1 and before.text in (">", "*", "&", "&&"))):
            return True
    return False


def without_template_arguments(statement):
    """The statement without `<…>` lists, whose commas separate nothing of it."""
    kept, at = [], 0
    while at < len(statement):
        if statement[at] == "<" and kept and kept[-1].kind == "name":
            depth, end = 0, at
            while end < len(statement) and (
                statement[end].kind in ("name", "number")
                or statement[end].text in ("<", ">", ",", "::", "*", "&", "...", "(", ")", "[", "]")
            ):
                depth += {"<": 1, ">": -1}.get(statement[end].text, 0)
                end += 1
                if depth == 0:
                    break
            if depth == 0:
                at = end
                continue
        kept.append(statement[at])
        at += 1
    return kept


def comma_chains(tree):
    for name, reader in tree.readers.items():
        for d in reader.declarations:
            if not d.body:
                continue
            for statement in reader.statements(d.body[0] + 1, d.body[1]):
                statement = without_template_arguments(without_control(statement))
                parts, start = [], 0
                for k, token in enumerate(statement):
                    if token == "," and token.kind == "sign":
                        parts.append(statement[start:k])
                        start = k + 1
                parts.append(statement[start:])
                assigning = [p for p in parts if any(t.kind == "sign" and t.text in ASSIGNMENTS for t in p)]
                if (
                    len(assigning) > 1
                    and not is_declaration(parts[0])
                    and statement[0].text not in ("return", "co_return")
                ):
                    yield f"{name}:{statement[0].line}: assignments are chained by comma ({len(assigning)}, 1)"


# ---- template parameters that nobody passes


def default_of_nobody(parameter):
    """Is the default `void`, or a name that the parameter repeats?"""
    texts = [t.text for t in parameter.default]
    if texts == ["void"]:
        return True
    return bool(texts) and texts[-1] == parameter.name and all(t.kind == "name" or t == "::" for t in parameter.default)


def deducible(function):
    """Names that a call's arguments (or the class before the name) determine: those in the parameters' types, but not
    before `::`, where nothing is deduced."""
    found = set()
    for part in function.parameters:
        depth = 0
        for k, token in enumerate(part):
            if token.text in "([{":
                depth += 1
            elif token.text in ")]}":
                depth -= 1
            elif token == "=" and depth == 0:
                break
            elif token.kind == "name" and not (k + 1 < len(part) and part[k + 1] == "::"):
                found.add(token.text)
    return found | {t.text for t in function.qualifier if t.kind == "name"}


def passed_by_name(tree):
    """Name → the most template arguments that some use of it passes."""
    most = collections.Counter()
    for reader in tree.readers.values():
        t = reader.tokens
        for k in range(len(t) - 1):
            if t[k].kind == "name" and t[k + 1] == "<" and t[k + 1].kind == "sign":
                end = reader.over_angles(k + 1)
                if end > k + 3 and t[end - 1] == ">":
                    most[t[k].text] = max(most[t[k].text], len(reader.split(k + 2, end - 1)))
    return most


def not_passed(function, passed):
    """Template parameters of a function that no call determines; nobody can pass those of constructors."""
    known = deducible(function)
    explicit = 0 if function.name == function.inside or function.name.startswith("operator") else passed[function.name]
    return [
        p
        for at, p in enumerate(function.heads[-1])
        if p.name not in known and at >= explicit and not default_of_nobody(p)
    ]


def shown(parameter):
    return f"template parameter {parameter.name}" if parameter.name else "template parameter without a name"


def phantoms(tree):
    passed = passed_by_name(tree)
    for name, reader in tree.readers.items():
        for d in reader.declarations:
            for parameter in (p for head in d.heads for p in head):
                if default_of_nobody(parameter):
                    yield f"{name}:{parameter.line}: {shown(parameter)} of {d.name} has a default that nobody replaces"
            if d.kind == "type" and re.search(r"[a-z]Of$", d.name) and d.heads and all(p.default for p in d.heads[-1]):
                yield f"{name}:{d.line}: {d.name} is a template for its own default only"
            if d.kind == "function" and d.heads and not re.match(r'operator(?:""|\w)', d.name):
                for parameter in not_passed(d, passed):
                    yield f"{name}:{parameter.line}: {shown(parameter)} of {d.name} is neither deduced nor passed"
        for number, line in enumerate(tree.texts[name].splitlines(), 1):
            match = re.search(r"\b(?:In|Dependent)<|\b\w+Of<>", line.split("//")[0])
            if match:
                yield f"{name}:{number}: {match.group(0)} hides a type behind a template parameter"


def names_of_tests(tree):
    """CTest's lists end their items at a semicolon: a name with one becomes two tests that cannot be found."""
    for name, text in tree.texts.items():
        for number, line in enumerate(text.splitlines(), 1):
            if re.search(r'\bTEST_CASE\("[^"]*;', line):
                yield f"{name}:{number}: the name of a test has a semicolon, at which CTest splits it"


CHECKS = {
    "lines": long_lines,
    "functions": functions,
    "parameters": parameters,
    "rooms": rooms,
    "details": details,
    "words": words,
    "paths": dead_paths,
    "map": map_of_tree,
    "comma chains": comma_chains,
    "phantom parameters": phantoms,
    "test names": names_of_tests,
}


def check(root):
    """Kind → its violations."""
    tree = Tree(root)
    return {kind: list(one(tree)) for kind, one in CHECKS.items()}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("root")
    parser.add_argument("--count", action="store_true")
    arguments = parser.parse_args()
    found = check(arguments.root)
    for kind, faults in found.items():
        print(
            f"{kind}: {len(faults)}" if arguments.count else "\n".join(faults),
            end="\n" if arguments.count or faults else "",
        )
    total = sum(map(len, found.values()))
    if total == 0:
        print("the house is in order")
    return 1 if total else 0


if __name__ == "__main__":
    sys.exit(main())
