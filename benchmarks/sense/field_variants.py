"""Recordings as the world writes them: variants of a virtual log, each with one thing that is otherwise in the field, and
what the program makes of them.

    lumo lab force --coarse --seed 7 --out LOG
    lumo lab force --joints 2 --coarse --seed 7 --out LOG2
    python benchmarks/sense/field_variants.py LOG LOG2 LUMO [BEFORE] > table.md

LUMO and BEFORE are programs; the table has a column for each. Needs numpy and opencv-python-headless. Pictures are halved,
so that a variant takes seconds. `right` is what the unchanged log gives, or what a note must contain."""

import csv
import dataclasses
import json
import pathlib
import subprocess
import sys
import tempfile
import typing

import cv2
import numpy as np

FROM_NS, TO_NS = 4_000_000_000, 30_000_000_000  # free motion, then three contacts
MAGIC = b"\x89MCAP0\r\n"


@dataclasses.dataclass
class Log:
    """Tables as columns of texts, and pictures."""

    session: dict
    tables: dict
    pictures: list

    @classmethod
    def read(cls, folder, from_ns=FROM_NS, to_ns=TO_NS, scale=0.5):
        folder = pathlib.Path(folder)
        tables = {}
        for name in ["frames", "joint", "wrench", "truth"]:
            with open(folder / f"{name}.csv") as file:
                head, *rows = csv.reader(file)
            rows = [r for r in rows if from_ns <= int(r[0]) <= to_ns]
            tables[name] = {h: [r[k] for r in rows] for k, h in enumerate(head)}
        session = json.loads((folder / "session.json").read_text())
        session["segments"] = [s for s in session["segments"] if from_ns < s["to_ns"] <= to_ns]
        pictures = [
            cv2.resize(cv2.imread(str(folder / "frames" / f), cv2.IMREAD_UNCHANGED), None, fx=scale, fy=scale,
                       interpolation=cv2.INTER_AREA)
            for f in tables["frames"]["file"]
        ]
        return cls(session, tables, pictures)

    def copy(self):
        return Log(
            json.loads(json.dumps(self.session)),
            {name: {h: list(c) for h, c in table.items()} for name, table in self.tables.items()},
            list(self.pictures),
        )

    def change(self, table, column, by):
        """`by(value, k)` gives the new one."""
        self.tables[table][column] = [repr(float(by(float(v), k))) for k, v in enumerate(self.tables[table][column])]

    def names(self, new):
        """Gives the joints' columns other names; the order of the columns is theirs."""
        joint = self.tables["joint"]
        columns = {"stamp_ns": joint["stamp_ns"]}
        for old, name in new:
            for quantity in ["position_rad", "velocity_rad_per_s", "current_A"]:
                columns[f"{quantity}_{name}"] = joint[f"{quantity}_{old}"]
        self.tables["joint"] = columns

    def write_tables(self, folder):
        folder.mkdir(parents=True)
        (folder / "session.json").write_text(json.dumps(self.session))
        for name, table in self.tables.items():
            with open(folder / f"{name}.csv", "w", newline="") as file:
                out = csv.writer(file, lineterminator="\n")
                out.writerow(table)
                out.writerows(zip(*table.values(), strict=True))

    def write(self, folder, quality=()):
        self.write_tables(folder)
        (folder / "frames").mkdir()
        for file, picture in zip(self.tables["frames"]["file"], self.pictures, strict=True):
            cv2.imwrite(str(folder / "frames" / file), picture, quality)


@dataclasses.dataclass
class Variant:
    name: str
    what: str
    make: typing.Callable  # changes a copy of the log
    right: str  # for people
    good: typing.Callable  # of (result, control, notes)
    options: tuple = ()
    two_joints: bool = False
    pack: typing.Callable | None = None  # of the bytes of an MCAP file, which the log then becomes


def frames_with_force(result):
    """Programs before November 2026 call them samples."""
    return result["frames"]["with_force"] if "frames" in result else result["samples"]


def as_control(result, control, notes):
    """Within 15 % of the control's error, and with seven in eight of its frames that have a force."""
    return (
        result["mae_N"]["fused"] is not None
        and result["mae_N"]["fused"] < 1.15 * control["mae_N"]["fused"] + 0.05
        and frames_with_force(result) > 0.875 * frames_with_force(control)
    )


def noted(*words):
    return lambda result, control, notes: all(any(w in n for n in notes) for w in words)


def noted_and_right(*words):
    return lambda result, control, notes: noted(*words)(result, control, notes) and as_control(result, control, notes)


def latency(ms):
    def good(result, control, notes):
        found = result.get("latency")
        return found is not None and abs(found["joints_later_ms"] - ms) < 3.0 * found["sigma_ms"]

    return good


def nothing(log):
    pass


def extra_joints(log):
    log.names([("0", "finger")])
    joint = log.tables["joint"]
    rows = len(joint["stamp_ns"])
    joint |= {"position_rad_arm": ["nan"] * rows, "current_A_arm": [""] * rows}


def blank(column, every):
    def make(log):
        log.tables["joint"][column] = ["nan" if k % every == 1 else v for k, v in enumerate(log.tables["joint"][column])]

    return make


def scaled(table, column, by):
    return lambda log: log.change(table, column, by)


def joints_later(seconds):
    def make(log):
        log.tables["joint"]["stamp_ns"] = [str(int(t) + int(1e9 * seconds)) for t in log.tables["joint"]["stamp_ns"]]

    return make


def light(by):
    """`by(k, x)`: the factor on picture k at its columns x."""

    def make(log):
        log.pictures = [
            np.clip(p * by(k, np.arange(p.shape[1])) + 0.5, 0, 255).astype(np.uint8) for k, p in enumerate(log.pictures)
        ]

    return make


def bands(k, x):
    """Lines along the finger that a rolling shutter exposes one after the other, under lamps that flicker."""
    return 1.0 + 0.03 * np.sin(2.0 * np.pi * (x / 60 + 0.37 * k))


def microseconds(log):
    for table in log.tables.values():
        table["stamp_ns"] = [str(int(t) // 1000) for t in table["stamp_ns"]]
    for segment in log.session["segments"]:
        segment["from_ns"] //= 1000
        segment["to_ns"] //= 1000


def gear(log):
    log.session["torque_constant_Nm_per_A"] = [10 * k for k in log.session["torque_constant_Nm_per_A"]]


def drift(log):
    rows = len(log.tables["wrench"]["stamp_ns"])
    log.tables.pop("truth")
    log.change("wrench", "force_z_N", lambda v, k: v - 4.0 * k / rows)


def mounted(log):
    """The sensor's x points out of the pad, its y to the tip."""
    log.tables.pop("truth")
    wrench = log.tables["wrench"]
    for what in ["force_{}_N", "torque_{}_Nm"]:
        x, y, z = (wrench[what.format(a)] for a in "xyz")
        wrench[what.format("x")], wrench[what.format("y")], wrench[what.format("z")] = (
            z,
            y,
            [repr(-float(v)) for v in x],
        )


def reversed_sensor(log):
    log.tables.pop("truth")
    for a in "xyz":
        log.change("wrench", f"force_{a}_N", lambda v, k: -v)


def without_segments(log):
    log.session["segments"] = []


def touched_at_once(log):
    """No segments, and a hand at the joint from 0.2 to 0.4 s, which pictures do not show."""
    without_segments(log)
    first = int(log.tables["joint"]["stamp_ns"][0])
    stamps = log.tables["joint"]["stamp_ns"]
    log.change("joint", "current_A_0", lambda v, k: v + (2.0 if 0.2 < 1e-9 * (int(stamps[k]) - first) < 0.4 else 0.0))


def held_throughout(log):
    """The stretch that is said to be unloaded was not: 5 N·m/A more until the first contact, as from a spring."""
    stamps, end = log.tables["joint"]["stamp_ns"], 10_480_000_000
    log.change("joint", "current_A_0", lambda v, k: v + (1.2 if int(stamps[k]) < end else 0.0))


def alphabetical(log):
    log.names([("1", "a_tip"), ("0", "b_base")])


def stated(log):
    alphabetical(log)
    log.session["joint_names"] = ["b_base", "a_tip"]


def padded_file(data):
    return data + bytes(100_000)


def cut_and_padded(data):
    return data[: 4 * len(data) // 5] + bytes(100_000)


VARIANTS = [
    Variant("control", "nothing", nothing, "error and frames of the control", as_control),
    Variant("extra_joints", "joints have names; one without numbers stands beside", extra_joints, "as the control",
            as_control, ("--joint-names", "finger")),
    Variant("velocity_nan", "every third velocity is NaN", blank("velocity_rad_per_s_0", 3), "as the control", as_control),
    Variant("effort_nan", "2 % of the efforts are NaN", blank("current_A_0", 50), "as the control, counted", as_control),
    Variant("effort_nan_often", "10 % of the efforts are NaN", blank("current_A_0", 10), "refused", None),
    Variant("velocity_rpm", "velocities in turns a minute", scaled("joint", "velocity_rad_per_s_0", lambda v, k: 9.549 * v),
            "from positions, noted", noted_and_right("velocities of joint 0")),
    Variant("current_mA", "currents in mA", scaled("joint", "current_A_0", lambda v, k: 1000 * v), "noted", noted("mA")),
    Variant("late_150", "joints are stamped 150 ms later", joints_later(0.15), "150 ms within its error, noted",
            lambda r, c, n: latency(150)(r, c, n) and noted("joint samples are stamped")(r, c, n)),
    Variant("late_150_given", "the same, given", joints_later(0.15), "as the control", as_control, ("--latency", "150")),
    Variant("early_40", "joints are stamped 40 ms earlier", joints_later(-0.04), "-40 ms within its error", latency(-40)),
    Variant("mains", "light rises and falls by 8 %", light(lambda k, x: 1.0 + 0.08 * np.sin(1.9 * k)),
            "as the control, noted", noted_and_right("rises and falls")),
    Variant("pulses", "every third picture has 20 % less light", light(lambda k, x: 0.8 if k % 3 == 0 else 1.0),
            "as the control, noted", noted_and_right("rises and falls")),
    Variant("bands", "bands of 3 % move along the finger", light(bands), "at most 1.1 times the control's frames, noted",
            lambda r, c, n: noted("in bands")(r, c, n) and frames_with_force(r) < 1.1 * frames_with_force(c)),
    Variant("microseconds", "stamps in µs", microseconds, "refused", None),
    Variant("degrees", "positions in degrees", scaled("joint", "position_rad_0", lambda v, k: 57.29578 * v), "refused",
            None),
    Variant("gear", "the session's torque constant is ten times too large", gear, "noted",
            noted("times what the force sensor")),
    Variant("over_exposed", "2.5 times the light", light(lambda k, x: 2.5), "noted", noted("are full (255)")),
    Variant("drift", "the force sensor drifts by 4 N; no truth", drift, "as the control, noted",
            noted_and_right("tared before each contact")),
    Variant("mounted", "the force sensor's x points out of the pad; no truth", mounted, "as the control", as_control,
            ("--wrench-axes=-z,y,x",)),
    Variant("reversed_sensor", "the finger's force on the object; no truth", reversed_sensor, "noted",
            noted("negative in the holds")),
    Variant("reversed_given", "the same, given", reversed_sensor, "as the control", as_control, ("--wrench-axes=-x,-y,-z",)),
    Variant("no_segments", "nobody wrote segments", without_segments, "as the control", as_control),
    Variant("touched_at_once", "no segments, a hand at the joint from 0.2 to 0.4 s", touched_at_once, "as the control",
            as_control),
    Variant("held_throughout", "the unloaded stretch was none", held_throughout, "noted",
            noted("where the pictures see no contact")),
    Variant("alphabetical", "two joints, named and listed from the tip", alphabetical, "as the control", as_control,
            ("--joint-names", "b_base,a_tip"), True),
    Variant("stated", "the same, the session states the order", stated, "as the control", as_control, (), True),
    Variant("padded", "an MCAP file with zeros behind its end", nothing, "as the control", as_control, (), False,
            padded_file),
    Variant("cut", "an MCAP file that was cut, in space that was allocated beforehand", nothing, "read up to there, noted",
            noted("read up to there"), (), False, cut_and_padded),
]  # fmt: skip


def run(program, *arguments):
    return subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=False)


def judged(program, variant, log, control):
    """What the program says of it, and whether that is right. Notes that the control has, too, are left out."""
    done = run(program, "force", log, "--json", *variant.options)
    notes = [line.removeprefix("lumo: ") for line in done.stderr.splitlines() if line.startswith("lumo: ")]
    if done.returncode != 0:
        why = notes[-1].replace(f"{log}/", "") if notes else str(done.returncode)
        return f"refused: {why[:90]}", variant.good is None
    result = json.loads(done.stdout)
    error = result["mae_N"]["fused"]
    late = result.get("latency")
    texts = [
        f"{frames_with_force(result)} frames",
        "no error" if error is None else f"{error:.2f} N",
        f"{late['joints_later_ms']:.0f} ± {late['sigma_ms']:.0f} ms" if late else "",
    ]
    own = [n.split(": ", 1)[-1] for n in notes if str(log) in n]
    texts += [n[:60] for n in own if n not in control.get("notes", [])]
    good = variant.good is not None and variant.good(result, control, notes)
    return "; ".join(t for t in texts if t), good


def control_of(program, log):
    done = run(program, "force", log, "--json")
    notes = [line.split(f"{log}: ", 1)[-1] for line in done.stderr.splitlines()]
    return json.loads(done.stdout) | {"notes": notes}


def main(one, two, *programs):
    logs = {False: Log.read(one), True: Log.read(two)}
    print("| variant | what | right | " + " | ".join(["after", "before"][: len(programs)]) + " |")
    print("|" + "---|" * (3 + len(programs)))
    wrong = 0
    with tempfile.TemporaryDirectory() as scratch:
        controls = {}
        for joints, log in logs.items():
            folder = pathlib.Path(scratch) / f"control{joints}"
            log.write(folder)
            controls[joints] = control_of(programs[0], folder)
        for v in VARIANTS:
            log = logs[v.two_joints].copy()
            v.make(log)
            folder = pathlib.Path(scratch) / v.name
            log.write(folder)
            if v.pack:
                file = pathlib.Path(scratch) / f"{v.name}.mcap"
                run(programs[0], "convert", folder, file)
                file.write_bytes(v.pack(file.read_bytes()))
                folder = file
            cells = [judged(p, v, folder, controls[v.two_joints]) for p in programs]
            wrong += not cells[0][1]
            shown = [("" if good else "**not right** ") + text.replace("|", "/") for text, good in cells]
            print(f"| {v.name} | {v.what} | {v.right} | " + " | ".join(shown) + " |", flush=True)
    print(f"{wrong} of {len(VARIANTS)} not right", file=sys.stderr)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
