"""What the scripts that write figures into pages share: the machine's name, and the part of a page that a script makes."""
import os
import pathlib
import platform
import re


def processor():
    """Name and number of threads."""
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    name = re.search(r"^model name\s*:\s*(.+)$", cpuinfo.read_text(encoding="utf-8"), re.MULTILINE) if cpuinfo.exists() else None
    return (name[1].strip() if name else platform.machine()), os.cpu_count()


def replace_part(page, begin, end, part):
    """Puts `part` between a page's two markers, lines of their own. Ends the program, the page as it was, where it lacks them."""
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise SystemExit(f"{page} lacks the markers {begin.strip()} and {end.strip()}")
    page.write_text(before + begin + part + end + after, encoding="utf-8")
