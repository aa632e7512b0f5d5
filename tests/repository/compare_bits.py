"""Compares what two builds of the program compute, bit by bit: before a refactoring and after it.

usage: compare_bits.py record  --program PATH --into FOLDER [--long] [--make-store PROGRAM] [--only WORD]
       compare_bits.py compare --program PATH --with FOLDER [--only WORD] [--words-may-differ]

`record` runs the list of commands below and keeps all that they print and write. `compare` runs them again with
another program. It reports each difference with its file and the first line or field that differs; the exit code is 1
if there is any. Pictures of logs and MCAP files are kept as digests. Standard error (progress, wording) is kept, but
not compared. All of it takes eight minutes of one core, and as long again to compare.

--long adds what runs for many minutes: a campaign of four evaluations, larger evaluations and studies.
--make-store gives the program made of tests/cli/make_store.cpp. The record keeps the campaign's store that it makes:
  status, verify, export, select and report read it, and a run that continues it is stopped at its next ask.
--only runs the commands whose names hold the word, and what they need.
--words-may-differ lets text differ as long as each number in it stays: for a revision of messages.
"""

import argparse
import base64
import difflib
import hashlib
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree

# What may differ between two runs of one program, and why.
MASKED_KEYS = {
    "seconds": "the clock's",
    "frame_ms": "the clock's: time that one frame took",
    "machine": "versions of processor, compiler and libraries, which notes keep",
    "lumo": "version of lumo, which notes keep",
    "threads": "of the machine, which notes keep",
}
MASKED_TEXT = [
    (
        re.compile(r"\b\d+(?:\.\d+)?(?:e[-+]\d+)? (?:s|ms|min|h)\b"),
        "<time>",
        "durations in texts and pages, by the clock",
    ),
    (
        re.compile(r"(<tr><td>[^<]+</td><td>[\w ]+</td><td>\d+</td><td>)[\d.]+"),
        r"\1<time>",
        "seconds in the table of study solver's page, by the clock",
    ),
    (re.compile(r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?)?Z?"), "<date>", "dates of files"),
    (re.compile(r"lumo \d+\.\d+\.\d+"), "lumo <version>", "version of lumo in headers of files"),
]
MASKED_COLUMNS = {"seconds": "the clock's"}
MASKED_TABLES = {
    "worker": "processes that hold the store",
    "head": "digest of the last entry; entries are compared themselves",
}
MASKED_FIELDS = {"digest": "follows from the entry's text; compared are the texts"}
DIGESTED = re.compile(r"\.(png|mcap|jpg)$")

SPACE = {
    "variables": [
        {"name": "a", "lower": 2, "upper": 29, "step": 0.5},
        {"name": "b", "lower": 1, "upper": 20, "step": 0.5},
        {"name": "t", "lower": -1, "upper": 1},
    ],
    "constraints": [{"terms": {"a": 1, "b": 1}, "upper": 20}, {"terms": {"b": 1, "a": -1}, "lower": -15, "upper": 12}],
    "objectives": [
        {"name": "f1", "goal": "maximize", "reference": -0.06},
        {"name": "f2", "goal": "minimize", "reference": 2},
    ],
    "initial": [[6, 6, 0], [4, 8, 0.25]],
    "sobol": 4,
    "evaluations": 14,
    "seed": 1,
}


class Command:
    """One run of the program in the folder of all runs: `text` are its words; `out` becomes --out NAME."""

    def __init__(self, name, text, needs=(), out=False, long=False, stdin=None, code=0):
        self.name, self.needs, self.long, self.stdin, self.code = name, needs, long, stdin, code
        self.words = text.split() + (["--out", name] if out else [])


COARSE = "--size 3 --element linear"  # 0.2 s a press
DESIGNS = {
    "baseline": "6,6,8,5,0",
    "dome": "5,10,10,6,3",
    "low": "9,1,8,3,2.5",
    "high": "3,12.5,7,8,5",
    "wide": "13.5,4,15,11.5,2",
    "gaps": "10,8,4.5,4,7.5",
}
PRESSES = {
    "quadratic": "--loads 1,5 --size 3",
    "linear": f"--loads 1,2,5 {COARSE}",
    "graded": "--loads 1 --material Sol",
    "friction": f"--loads 1,2,5 {COARSE} --friction 0.5",
    "quadratic_friction": "--loads 1,3 --size 3 --friction 0.5 --angle 15",
    "tilt": f"--loads 1,2 {COARSE} --angle 30 --y 5.5",
    "blunt": f"--loads 1,2 {COARSE} --diameter 30 --theta 5,10,10,6,3",
    "sharp": f"--loads 0.5,1 {COARSE} --diameter 6 --y -11",
    "newton": f"--loads 1,2 {COARSE} --law newton",
    "vertex": f"--loads 1,2 {COARSE} --contact-points vertex --contact-stiffness 1e10",
    "descent": f"--loads 1 {COARSE} --solver vbd",
    "descent_friction": "--loads 1,2 --size 4 --element linear --solver vbd --friction 0.5 --sweeps 5 --angle 20",
    "paper": "--loads 1,2 --size 3 --mode paper",
    "too_much": "--loads 1,500 --size 4 --element linear",
}
TRACES = {
    "clear": f"--material Sol --loads 1 {COARSE}",
    "scattering": f"--material DS --loads 1,2 {COARSE}",
    "gaps": f"--material DS --theta 5,10,10,6,3 --loads 1 {COARSE} --angle -30 --y 11",
    "clear_gaps": f"--material Sol --theta 10,8,4.5,4,7.5 --loads 1 {COARSE}",
    "quadratic": "--material DS --loads 1 --size 3",
    "paper": "--loads 1 --size 3 --mode paper",
}


def design_commands():
    for name, theta in DESIGNS.items():
        yield Command(f"section_{name}", f"section --theta {theta} --json", out=True)
        yield Command(f"mesh_{name}", f"mesh --theta {theta} --json --threads 1", out=True)
        yield Command(f"fabricate_{name}", f"fabricate --theta {theta} --json", out=True)
    yield Command("section_text", "section --theta 5,10,10,6,3")
    yield Command("section_infeasible", "section --theta 2,6,8,5,0", code=3)
    options = "--clearance 0.3 --plate 5 --wall 7 --gate 3 --vent 1.5"
    yield Command("fabricate_options", f"fabricate --theta 5,10,10,6,3 --material Sol {options} --json", out=True)


def physics_commands():
    for name, options in PRESSES.items():
        code = 4 if name == "too_much" else 0
        yield Command(f"press_{name}", f"press {options} --json --threads 1", out=True, code=code)
    yield Command("press_text", f"press --loads 1,2 {COARSE} --threads 1")
    for name, options in TRACES.items():
        yield Command(f"trace_{name}", f"trace {options} --json --threads 1", out=True)
    yield Command("trace_text", f"trace --loads 1 {COARSE} --threads 1")
    one = "--ray-error 100 --json --threads 1"
    curved = "--ensemble curved --material Sol --theta 5,10,10,6,3"
    yield Command("evaluate", f"evaluate --size 6 --element linear {one}", out=True)
    yield Command("evaluate_curved", f"evaluate --size 6 --element linear {curved} {one}", out=True, long=True)
    yield Command("evaluate_paper", f"evaluate --size 5 --mode paper --sweeps 1 {one}", out=True, long=True)
    yield Command("study_solver", "study solver --loads 1 --size 4 --friction 0.3 --json --threads 1", out=True)


def store_commands():
    """On a store that is given: read, chosen from, shown, continued up to the next ask."""
    yield Command("store_status", "campaign status --json --store store.db")
    yield Command("store_status_text", "campaign status --store store.db")
    yield Command("store_verify", "campaign verify --json --store store.db")
    yield Command("store_export", "campaign export --json --store store.db")
    yield Command("store_export_csv", "campaign export --csv --store store.db")
    yield Command("store_select", "campaign select --seeds 2 --json --threads 1 --store store.db")
    yield Command("store_report", "campaign report --threads 1 --store store.db --out store_report.html")
    text = "campaign run --evaluations 99 --threads 1 --store store_next.db"
    yield Command("store_next", text, stdin="stop at ask", code=130)


def search_commands(has_store):
    for source in ("default", "paper"):
        text = f"optimize --space {source}_space.json --transcript optimize_{source}.jsonl"
        yield Command(f"optimize_{source}", text, stdin="answers")
    if has_store:
        yield from store_commands()
    run = "campaign run --ray-error 100 --threads 1 --json"
    yield Command("campaign_one", f"{run} --evaluations 1 --store campaign_one.db")
    yield Command("campaign", f"{run} --evaluations 4 --store campaign.db", long=True)
    after = {"needs": ["campaign"], "long": True}
    yield Command("campaign_export", "campaign export --csv --store campaign.db", **after)
    yield Command("campaign_select", "campaign select --seeds 2 --json --threads 1 --store campaign.db", **after)
    yield Command(
        "campaign_report", "campaign report --threads 1 --store campaign.db --out campaign_report.html", **after
    )
    study = "--threads 1 --json --store"
    yield Command("study_carrier", f"study carrier --designs 1 {study} study_carrier.db", out=True)
    yield Command("study_void", f"study void --designs 2 {study} study_void.db", out=True, long=True)


def lab_commands():
    computed = "--json --threads 1 --cache cache"
    for kind in ("recontact", "cycle", "imaging", "force", "hand"):
        yield Command(f"lab_{kind}", f"lab {kind} --coarse --seed 1 {computed}", out=True)
    yield Command("lab_two", f"lab force --coarse --seed 3 --joints 2 --noise 0.5 {computed}", out=True)
    specimen = f"lab imaging --coarse --stiffness 1.15 --lamps 0.8 {computed}"
    yield Command("lab_specimen", specimen, out=True, long=True)


def sensing_commands():
    """On logs of the lab."""

    def of(log, name, text, out=True):
        return Command(name, f"{text} --json", needs=[log], out=out)

    for decoder in ("nearest", "linear", "gp", "bayes"):
        yield of("lab_recontact", f"decode_{decoder}", f"decode lab_recontact --decoder {decoder}")
    yield Command("decode_text", "decode lab_recontact", needs=["lab_recontact"])
    yield of("lab_recontact", "metrics_recontact", "metrics lab_recontact")
    yield of("lab_cycle", "metrics_cycle", "metrics lab_cycle --baseline lab_cycle")
    yield of("lab_imaging", "metrics_imaging", "metrics lab_imaging")
    for localizer in ("bayes", "peak"):
        yield of("lab_force", f"locate_{localizer}", f"locate lab_force --localizer {localizer}")
        yield of("lab_force", f"force_{localizer}", f"force lab_force --localizer {localizer}")
    yield of("lab_two", "force_two", "force lab_two")
    yield Command("force_text", "force lab_force", needs=["lab_force"])
    yield of("lab_hand", "hand", "hand lab_hand")
    yield of("lab_imaging", "calibrate", "calibrate lab_imaging --coarse --threads 1 --cache cache", out=False)
    yield of("lab_force", "convert_force", "convert lab_force force.mcap", out=False)
    yield of("lab_force", "convert_lz4", "convert lab_force force_lz4.mcap --compression lz4", out=False)
    yield of("lab_imaging", "convert_raw", "convert lab_imaging imaging_raw.mcap --compression none --raw", out=False)
    yield of("convert_force", "convert_back", "convert force.mcap convert_back", out=False)
    yield of("convert_raw", "convert_raw_back", "convert imaging_raw.mcap convert_raw_back", out=False)
    yield of("lab_recontact", "convert_recontact", "convert lab_recontact recontact.mcap", out=False)
    yield of("convert_force", "locate_mcap", "locate force.mcap")
    yield of("convert_lz4", "force_mcap", "force force_lz4.mcap")
    yield of("convert_recontact", "decode_mcap", "decode recontact.mcap")


def commands(has_store):
    """All commands, in the order in which they run. What a command writes lies in a folder or a file of its name."""
    return [*design_commands(), *physics_commands(), *search_commands(has_store), *lab_commands(), *sensing_commands()]


def chosen(all_commands, long, word):
    """Those whose names hold the word, with what they need, in order."""
    by_name = {c.name: c for c in all_commands}
    names = set()

    def take(name):
        names.add(name)
        for needed in by_name[name].needs:
            take(needed)

    for c in all_commands:
        if word in c.name and (long or not c.long):
            take(c.name)
    return [c for c in all_commands if c.name in names]


def measure(x):
    """Objectives for ask and tell, by operations that every machine rounds alike."""
    a, b, t = x[0] / 20, x[1] / 20, x[2]
    return [
        1 - (a - 0.3) * (a - 0.3) - (b - 0.4) * (b - 0.4) - 0.1 * t * t,
        (a - 0.7) * (a - 0.7) + (b - 0.1) * (b - 0.1) + 0.1 * (t - 0.5) * (t - 0.5),
    ]


def answer_asks(words, folder, errors):
    """Answers each ask of `lumo optimize`; the text that it wrote, and its exit code."""
    process = subprocess.Popen(
        words, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True
    )
    lines = []
    for line in process.stdout:
        lines.append(line)
        message = json.loads(line)
        if "ask" not in message:
            break
        process.stdin.write(
            json.dumps({"tell": {"id": message["ask"]["id"], "y": measure(message["ask"]["x"])}}) + "\n"
        )
        process.stdin.flush()
    process.stdin.close()
    return "".join(lines) + process.stdout.read(), process.wait()


def count_entries(store):
    with sqlite3.connect(store) as db:
        return db.execute("SELECT count(*) FROM entry").fetchone()[0]


def stop_at_ask(words, folder, errors):
    """Interrupts a campaign when it has written its next ask to the store."""
    store = folder / words[-1]
    shutil.copy(folder / "store.db", store)
    before = count_entries(store)
    process = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=errors)
    while process.poll() is None and count_entries(store) == before:
        time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    return "", process.wait()


def run_one(program, command, folder):
    words = [str(program), *command.words]
    with open(folder / f"{command.name}.stderr", "w", encoding="utf-8") as errors:
        if command.stdin == "answers":
            text, code = answer_asks(words, folder, errors)
        elif command.stdin == "stop at ask":
            text, code = stop_at_ask(words, folder, errors)
        else:
            done = subprocess.run(words, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors)
            text, code = done.stdout.decode("utf-8", errors="backslashreplace"), done.returncode
    (folder / f"{command.name}.stdout").write_text(text, encoding="utf-8")
    (folder / f"{command.name}.exit").write_text(f"{code}\n", encoding="utf-8")
    return code


def run_all(program, wanted, folder):
    """Runs the commands in `folder`; the names of those whose exit code is another than expected."""
    for source in ("default", "paper"):
        (folder / f"{source}_space.json").write_text(json.dumps(dict(SPACE, source=source)), encoding="utf-8")
    failed = []
    for number, command in enumerate(wanted, 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        code = run_one(program, command, folder)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        print(
            f"[{number}/{len(wanted)}] {command.name}: exit code {code}, {spent:.1f} s of processor",
            file=sys.stderr,
            flush=True,
        )
        if code != command.code:
            failed.append(command.name)
    return failed


# ---- what is compared


def masked_json(value):
    if isinstance(value, dict):
        return {k: "<masked>" if k in MASKED_KEYS else masked_json(v) for k, v in value.items()}
    return [masked_json(v) for v in value] if isinstance(value, list) else value


def masked_text(text):
    for pattern, mark, _ in MASKED_TEXT:
        text = pattern.sub(mark, text)
    return text


def masked_csv(text):
    lines = text.splitlines()
    keep = [k for k, name in enumerate(lines[0].split(",")) if name not in MASKED_COLUMNS] if lines else []
    # Fields in quotes hold no masked column before them: `why` is the last one.
    return [",".join(fields[k] for k in keep if k < len(fields)) for fields in (line.split(",") for line in lines)]


def json_lines(value, path=""):
    """One line a number, text or null, with its path: a difference names its field."""
    if isinstance(value, dict):
        return [line for k, v in value.items() for line in json_lines(v, f"{path}.{k}")] or [f"{path} {{}}"]
    if isinstance(value, list):
        return [line for k, v in enumerate(value) for line in json_lines(v, f"{path}[{k}]")] or [f"{path} []"]
    return [f"{path} = {json.dumps(value)}"]


def vtu_lines(path):
    """Each value of a .vtu file in full digits, as array[index] = value."""
    formats = {"Float64": "d", "Int64": "q", "UInt8": "B"}
    lines = []
    for array in xml.etree.ElementTree.parse(path).getroot().iter("DataArray"):
        data = base64.b64decode(array.text)[8:]
        code = formats[array.get("type")]
        values = struct.unpack(f"<{len(data) // struct.calcsize(code)}{code}", data)
        lines += [f"{array.get('Name')}[{k}] = {v!r}" for k, v in enumerate(values)]
    return lines


def cell_lines(value):
    try:
        return json_lines(masked_json(json.loads(value)))
    except (TypeError, ValueError):
        return str(value).splitlines() or [""]


def sqlite_lines(path):
    """Each field of each row but what is masked; JSON in a field by its own fields."""
    lines = []
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as db:
        # A failure's text may be any bytes.
        db.text_factory = lambda raw: raw.decode("utf-8", errors="backslashreplace")
        for (table,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name").fetchall():
            if table in MASKED_TABLES:
                continue
            rows = db.execute(f"SELECT * FROM {table} ORDER BY 1")
            names = [c[0] for c in rows.description]
            for number, row in enumerate(rows):
                for name, value in zip(names, row):
                    if name not in MASKED_FIELDS:
                        lines += [f"{table}[{number}].{name}: {line}" for line in cell_lines(value)]
    return lines


def content(path):
    """Lines of a file, masked: what two records must share."""
    name = path.name
    if DIGESTED.search(name):
        return [hashlib.sha256(path.read_bytes()).hexdigest()]
    if name.endswith(".db"):
        return sqlite_lines(path)
    if name.endswith(".vtu"):
        return vtu_lines(path)
    try:
        text = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError:
        return [hashlib.sha256(path.read_bytes()).hexdigest()]
    if name.endswith((".json", ".stdout")) and text.lstrip().startswith(("{", "[")):
        try:
            return json_lines(masked_json(json.loads(text)))
        except ValueError:  # one JSON value a line, or none
            pass
    if name.endswith(".csv") or "_csv" in name:
        return masked_csv(text)
    return masked_text(text).splitlines()


def files_of(folder):
    """Files that are compared. Standard error reports progress; the rest of SQLite's files come and go."""
    skipped = re.compile(r"\.stderr$|\.db-(wal|shm|journal)$|^(store\.db|record\.json)$")
    return sorted(
        p.relative_to(folder).as_posix()
        for p in folder.rglob("*")
        if p.is_file() and not skipped.search(p.relative_to(folder).as_posix())
    )


NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def numbers(lines):
    return [n for line in lines for n in NUMBER.findall(line)]


def shortened(line):
    return line if len(line) <= 200 else line[:200] + f" … ({len(line)} characters)"


def difference(name, before, after, words_may_differ):
    """The first difference of two files, in one text, or None."""
    if before == after or (words_may_differ and not DIGESTED.search(name) and numbers(before) == numbers(after)):
        return None
    if DIGESTED.search(name):
        return f"{name}: other bytes"
    changed = (
        sum(
            max(b - a, d - c)
            for tag, a, b, c, d in difflib.SequenceMatcher(None, before, after, False).get_opcodes()
            if tag != "equal"
        )
        if len(before) + len(after) < 4000
        else None
    )
    for number, (a, b) in enumerate(zip(before, after), 1):
        if a != b:
            at = next((k for k, (x, y) in enumerate(zip(a, b)) if x != y), min(len(a), len(b)))
            start = max(0, at - 60) if len(a) > 200 else 0
            count = f", {changed} lines differ" if changed else ""
            return f"{name}:{number}{count}:\n  - {shortened(a[start:])}\n  + {shortened(b[start:])}"
    return f"{name}: {len(before)} lines before, {len(after)} after"


def recorded_content(folder, name, digests):
    return [digests[name]] if name in digests else content(folder / name)


def compare(record, run, names, words_may_differ=False):
    """All differences between a record and a run, of the files that belong to `names` (None: of all)."""
    digests = json.loads((record / "record.json").read_text(encoding="utf-8"))["digests"]

    def belongs(file):
        return names is None or re.split(r"[./]", file)[0] in names

    before = {f for f in set(files_of(record)) | set(digests) if belongs(f)}
    after = {f for f in files_of(run) if belongs(f)}
    found = [f"{f}: is no longer written" for f in sorted(before - after)] + [
        f"{f}: was not written before" for f in sorted(after - before)
    ]
    for name in sorted(before & after):
        what = difference(name, recorded_content(record, name, digests), content(run / name), words_may_differ)
        if what:
            found.append(what)
    return found


def keep(folder):
    """Leaves digests in place of pictures and MCAP files, and says what they are."""
    digests = {}
    for name in files_of(folder):
        if DIGESTED.search(name):
            digests[name] = content(folder / name)[0]
            (folder / name).unlink()
    return digests


def record(arguments):
    folder = arguments.into
    if folder.exists() and any(folder.iterdir()):
        raise SystemExit(f"{folder}: is not empty")
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.make_store:
        subprocess.run([arguments.make_store, folder / "store.db", "DS", "flat", "24"], check=True)
    wanted = chosen(commands(arguments.make_store is not None), arguments.long, arguments.only)
    failed = run_all(arguments.program, wanted, folder)
    digests = keep(folder)
    (folder / "record.json").write_text(
        json.dumps({"commands": [c.name for c in wanted], "digests": digests}, indent=1), encoding="utf-8"
    )
    print(f"{len(wanted)} commands, {len(files_of(folder)) + len(digests)} files recorded in {folder}")
    return failed


def compare_again(arguments):
    folder = arguments.record
    recorded = json.loads((folder / "record.json").read_text(encoding="utf-8"))["commands"]
    has_store = (folder / "store.db").exists()
    wanted = [c for c in chosen(commands(has_store), True, arguments.only) if c.name in recorded]
    with tempfile.TemporaryDirectory() as scratch:
        run = pathlib.Path(scratch)
        if has_store:
            shutil.copy(folder / "store.db", run / "store.db")
        run_all(arguments.program, wanted, run)
        names = None if not arguments.only else {c.name for c in wanted}
        found = compare(folder, run, names, arguments.words_may_differ)
    print("\n".join(found))
    print(
        f"{len(found)} differences in what {len(wanted)} commands print and write"
        if found
        else f"no difference in what {len(wanted)} commands print and write"
    )
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    actions = parser.add_subparsers(dest="action", required=True)
    for action, option, target in (("record", "--into", "into"), ("compare", "--with", "record")):
        one = actions.add_parser(action)
        one.add_argument("--program", type=lambda p: pathlib.Path(p).resolve(), required=True)
        one.add_argument(option, dest=target, type=lambda p: pathlib.Path(p).resolve(), required=True)
        one.add_argument("--only", default="")
        if action == "record":
            one.add_argument("--long", action="store_true")
            one.add_argument("--make-store", type=lambda p: pathlib.Path(p).resolve())
        else:
            one.add_argument("--words-may-differ", action="store_true")
    arguments = parser.parse_args()
    if arguments.action == "record":
        failed = record(arguments)
        print("".join(f"{name}: unexpected exit code, see {name}.stderr\n" for name in failed), end="")
        return 1 if failed else 0
    return 1 if compare_again(arguments) else 0


if __name__ == "__main__":
    sys.exit(main())
