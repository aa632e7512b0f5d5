"""Checks that include arrows point one way, along the order of the stages, and that lumo.hpp includes nothing that is dear to compile.

usage: check_includes.py include/lumo
"""
import pathlib
import re
import sys

# A stage may include itself and what stands after the colon.
STAGES = ["core", "morphology", "mesh", "mechanics", "optics", "objective"]
ALLOWED = {stage: set(STAGES[: i + 1]) for i, stage in enumerate(STAGES)}
ALLOWED["optimize"] = {"core", "optimize"}
ALLOWED["sense"] = {"core", "sense"}
ALLOWED["lab"] = set(STAGES) | {"sense", "lab"}
ALLOWED["fabrication"] = {"core", "morphology", "mesh", "fabrication"}
ALLOWED["campaign"] = set(STAGES) | {"optimize", "sense", "lab", "fabrication", "campaign"}
ALLOWED["support"] = ALLOWED["campaign"] | {"support"}
ALLOWED[""] = ALLOWED["campaign"] | {""}  # umbrella headers, which need Eigen only

STANDARD = set(
    """algorithm any array atomic barrier bit bitset charconv chrono cmath compare complex concepts condition_variable
    coroutine cstddef cstdint cstdio cstdlib cstring ctime deque exception execution expected filesystem format forward_list fstream
    functional future initializer_list iomanip ios iosfwd iostream istream iterator latch limits list locale map memory
    memory_resource mutex new numbers numeric optional ostream queue random ranges ratio regex scoped_allocator semaphore
    set shared_mutex source_location span sstream stack stdexcept stop_token streambuf string string_view syncstream
    system_error thread tuple type_traits typeindex typeinfo unordered_map unordered_set utility valarray variant vector
    version cassert cctype cerrno cfenv cfloat cinttypes climits clocale csetjmp csignal cstdarg cuchar cwchar cwctype""".split()
)
SYSTEM = {"sys/stat.h", "time.h"}   # in place of what is dear
DEAR = {"chrono", "condition_variable", "filesystem", "future", "iomanip", "iostream", "locale", "random", "ranges", "regex", "thread"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')


def stage_of(path):
    """First folder of a path inside include/lumo; empty for a header that lies in no folder."""
    parts = pathlib.PurePosixPath(path).parts
    return parts[0] if len(parts) > 1 else ""


def cycle(graph):
    """A list of headers that include each other in a ring, or None."""
    done, trail = set(), []

    def visit(node):
        if node in trail:
            return trail[trail.index(node):] + [node]
        if node in done:
            return None
        trail.append(node)
        for target in graph.get(node, ()):
            found = visit(target)
            if found:
                return found
        trail.pop()
        done.add(node)
        return None

    for node in graph:
        found = visit(node)
        if found:
            return found
    return None


def reached(graph, start):
    """All headers that `start` includes, itself too."""
    found, waiting = set(), [start]
    while waiting:
        header = waiting.pop()
        if header not in found:
            found.add(header)
            waiting += graph.get(header, ())
    return found


def check(root):
    root = pathlib.Path(root)
    faults, graph, dear = [], {}, []
    headers = sorted(root.rglob("*.hpp"))
    if not headers:
        return [f"{root}: no headers found"]
    for header in headers:
        here = header.relative_to(root).as_posix()
        stage = stage_of(here)
        if stage not in ALLOWED:
            faults.append(f"{here}: folder '{stage}' is no stage")
            continue
        graph[here] = []
        for number, line in enumerate(header.read_text(encoding="utf-8").splitlines(), 1):
            match = INCLUDE.match(line)
            if not match:
                continue
            bracket, target = match.groups()
            where = f"{here}:{number}"
            if target in DEAR:
                dear.append((here, f"{where}: lumo.hpp must not include <{target}>, which is dear to compile"))
            if target.startswith("lumo/"):
                inside = target[len("lumo/"):]
                if bracket == "<":
                    faults.append(f"{where}: lumo's own headers are included with quotes: <{target}>")
                if not (root / inside).is_file():
                    faults.append(f"{where}: no such header: {target}")
                graph[here].append(inside)
                if stage_of(inside) not in ALLOWED[stage]:
                    faults.append(f"{where}: {stage or 'the umbrella'} must not include {stage_of(inside)} ({target})")
            elif bracket == '"':
                faults.append(f'{where}: write the path from the include folder: "{target}"')
            elif stage != "support" and target not in STANDARD | SYSTEM and not target.startswith(("Eigen/", "unsupported/Eigen/")):
                faults.append(f"{where}: only support/ may include a foreign library: <{target}>")
    behind_lumo = reached(graph, "lumo.hpp")
    faults += [fault for header, fault in dear if header in behind_lumo]
    ring = cycle(graph)
    if ring:
        faults.append("headers include each other: " + " -> ".join(ring))
    return faults


if __name__ == "__main__":
    found = check(sys.argv[1])
    print("\n".join(found) if found else "all includes point the right way")
    sys.exit(1 if found else 0)
