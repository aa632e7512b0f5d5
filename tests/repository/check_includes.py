"""Checks that include arrows point one way, along the order of the rooms, and that only adapters include foreign
libraries.

usage: check_includes.py include/lumo
A room is a folder with headers, named by its path: mechanics/contact.
"""

import pathlib
import re
import sys

# Each room and the rooms whose headers it may include, beside its own. A room stands below those that it includes; only
# a room and one inside it may include each other.
ROOMS = {
    "core": "",
    "drawing": "core",
    "geometry": "core",
    "morphology": "core geometry",
    "mesh": "core geometry morphology",
    "mechanics/materials": "core",
    "mechanics/indenters": "core geometry",
    "mechanics/elements": "core mechanics/materials mesh morphology",
    "mechanics/contact": "core mechanics/elements mechanics/indenters mesh morphology",
    "mechanics/solvers": "core mechanics/contact mechanics/elements mechanics/indenters mechanics/materials mesh",
    "mechanics": "core drawing mechanics/contact mechanics/elements mechanics/solvers mesh",
    "optics/surface": "core mesh morphology",
    "optics/transport": "core mesh morphology optics optics/surface",
    "optics": "core mechanics/contact mesh morphology optics/surface optics/transport",
    "objective": "core mechanics/contact morphology optics",
    "pipeline": "core mechanics mechanics/contact mesh morphology objective optics optics/transport",
    "model": "core",
    "optimize": "core model",
    "campaign": "core optimize pipeline",
    "study": "campaign core objective optimize pipeline",
    "fabrication": "core drawing geometry morphology",
    "sense/devices": "core",
    "sense/recording": "core sense/devices sense/recording/mcap",
    "sense/recording/mcap": "core sense/devices sense/recording",
    "sense/hand": "core sense/devices sense/recording",
    "sense/profile": "core sense/devices sense/recording",
    "sense/localize": "core sense/devices",
    "sense/joints": "core sense/devices sense/recording",
    "sense/force": "core sense/devices sense/joints sense/localize sense/profile sense/recording",
    "sense/decode": "core model sense/devices sense/recording",
    "sense/live": "core sense/devices sense/force sense/hand sense/localize sense/profile sense/recording",
    "sense": "core sense/devices sense/force sense/recording",
    "lab": "core morphology optics pipeline sense/devices sense/hand sense/localize sense/recording",
    "support/process": "core mesh sense/devices",
    "support": "campaign core fabrication geometry mechanics/elements mesh optics sense/devices sense/recording "
    "sense/recording/mcap support/process",
}
ALLOWED = {room: set(others.split()) | {room} for room, others in ROOMS.items()}
ALLOWED[""] = {room for room in ROOMS if not room.startswith("support")} | {
    ""
}  # umbrella headers, which need Eigen only

STANDARD = set("""algorithm any array atomic barrier bit bitset charconv chrono cmath compare complex concepts
    condition_variable coroutine cstddef cstdint cstdio cstdlib cstring ctime deque exception execution
    expected filesystem format forward_list fstream functional future initializer_list iomanip ios iosfwd
    iostream istream iterator latch limits list locale map memory memory_resource mutex new numbers numeric
    optional ostream queue random ranges ratio regex scoped_allocator semaphore set shared_mutex
    source_location span sstream stack stdexcept stop_token streambuf string string_view syncstream
    system_error thread tuple type_traits typeindex typeinfo unordered_map unordered_set utility valarray
    variant vector version cassert cctype cerrno cfenv cfloat cinttypes climits clocale csetjmp csignal
    cstdarg cuchar cwchar cwctype""".split())
# Standard C++ cannot bring a file to the disk, without which one that was renamed may be empty after a power failure.
SYSTEM = {"core/files.hpp": {"fcntl.h", "unistd.h"}, "core/part.hpp": {"fcntl.h", "sys/file.h", "sys/stat.h", "unistd.h"}}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]')


def room_of(path):
    """Folder of a path inside include/lumo, empty for a header in no folder. Details belong to the room about them."""
    folder = pathlib.PurePosixPath(path).parent
    if folder.name == "detail":
        folder = folder.parent
    return "" if folder == pathlib.PurePosixPath(".") else folder.as_posix()


def shown(room):
    return room or "the umbrella"


def cycle(graph):
    """A list of headers that include each other in a ring, or None."""
    done, trail = set(), []

    def visit(node):
        if node in trail:
            return trail[trail.index(node) :] + [node]
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


def check(root):
    root = pathlib.Path(root)
    faults, graph = [], {}
    headers = sorted(root.rglob("*.hpp"))
    if not headers:
        return [f"{root}: no headers found"]
    for header in headers:
        here = header.relative_to(root).as_posix()
        room = room_of(here)
        if room not in ALLOWED:
            faults.append(f"{here}: folder '{room}' is no room")
            continue
        graph[here] = []
        for number, line in enumerate(header.read_text(encoding="utf-8").splitlines(), 1):
            match = INCLUDE.match(line)
            if not match:
                continue
            bracket, target = match.groups()
            where = f"{here}:{number}"
            if target.startswith("lumo/"):
                inside = target[len("lumo/") :]
                if bracket == "<":
                    faults.append(f"{where}: lumo's own headers are included with quotes: <{target}>")
                if not (root / inside).is_file():
                    faults.append(f"{where}: no such header: {target}")
                graph[here].append(inside)
                if "/detail/" in inside and not here.startswith(inside[: inside.index("detail/")]):
                    faults.append(f"{where}: {target} is a detail, for headers of its own room only")
                if room_of(inside) not in ALLOWED[room]:
                    faults.append(f"{where}: {shown(room)} must not include {shown(room_of(inside))} ({target})")
            elif bracket == '"':
                faults.append(f'{where}: write the path from the include folder: "{target}"')
            elif (
                not (room + "/").startswith("support/")
                and target not in STANDARD
                and target not in SYSTEM.get(here, ())
                and not target.startswith(("Eigen/", "unsupported/Eigen/"))
            ):
                faults.append(f"{where}: only support/ may include a foreign library: <{target}>")
    ring = cycle(graph)
    if ring:
        faults.append("headers include each other: " + " -> ".join(ring))
    return faults


if __name__ == "__main__":
    found = check(sys.argv[1])
    print("\n".join(found) if found else "all includes point the right way")
    sys.exit(1 if found else 0)
