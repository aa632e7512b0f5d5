"""Checks that what is about any body knows nothing of the finger's own geometry: its design variables, its stem, its
lateral voids.

usage: check_vocabulary.py include/lumo
"""

import pathlib
import re
import sys

FINGER_ROOMS = {"morphology", "fabrication"}  # which make the finger: its body, its parts and moulds

WORDS = re.compile(
    r"""\b(?:h_fp|h_ep|w_s|h_s|w_v)(?:_\w+)?\b            # design variables
      | \b[Ss]tems?\b | \bstem_\w+ | \w+_stem\b | \bStem[A-Z]\w*
      | \b[Vv]oids\b | \bvoid_(?!t\b|pointer)\w* | \b\w+_voids?\b | \bVoid[A-Z]\w*
      | \b(?:an?|the|each|every|this|that|no|lateral|air|side|open|closed|through|into|behind)
        \s+void\b(?!\s*[*(&])                           # the noun, not the type
    """,
    re.VERBOSE,
)
CODE_VOID = re.compile(r"\b(?:is|same_as|is_same|as)_void\w*|remove_\w+|std::void_t|to_void_ptr")


def check(root):
    root = pathlib.Path(root)
    faults = []
    headers = sorted(root.rglob("*.hpp"))
    if not headers:
        return [f"{root}: no headers found"]
    for header in headers:
        here = header.relative_to(root)
        if here.parts[0] in FINGER_ROOMS:
            continue
        for number, line in enumerate(header.read_text(encoding="utf-8").splitlines(), 1):
            for match in WORDS.finditer(CODE_VOID.sub("", line)):
                owners = " or ".join(sorted(FINGER_ROOMS))
                faults.append(f"{here.as_posix()}:{number}: '{match.group(0)}' belongs to {owners}")
    return faults


if __name__ == "__main__":
    found = check(sys.argv[1])
    print("\n".join(found) if found else "only morphology/ and fabrication/ know the finger's geometry")
    sys.exit(1 if found else 0)
