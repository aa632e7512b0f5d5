"""What the scripts that write figures into pages share: the machine's name, and the part of a page that a script
makes."""

import os
import pathlib
import platform
import re


def processor():
    """Name and number of threads."""
    cpuinfo = pathlib.Path("/proc/cpuinfo")
    text = cpuinfo.read_text(encoding="utf-8") if cpuinfo.exists() else ""
    name = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return (name[1].strip() if name else platform.machine()), os.cpu_count()


def replace_part(page, begin, end, part):
    """Puts `part` between a page's two markers, lines of their own. If they are missing, the program ends and the page
    stays as it was."""
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise SystemExit(f"{page} lacks the markers {begin.strip()} and {end.strip()}")
    page.write_text(before + begin + part + end + after, encoding="utf-8")
