"""The program from outside: exit codes, messages, and what is written where.

usage: test_cli.py path/to/lumo
"""

import json
import os
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree

from refusal import check_refusal

LUMO = ""
FAULT, USAGE, INFEASIBLE, BAD_FILE = 1, 2, 3, 5
DESIGN_COMMANDS = ["section", "mesh", "press", "trace", "render", "evaluate"]


def run(*arguments, **options):
    environment = dict(os.environ, LC_ALL=options.pop("locale", "C"))
    return subprocess.run(
        [LUMO, *arguments],
        capture_output=True,
        text=True,
        timeout=options.pop("timeout", 60),
        env=environment,
        **options,
    )


# Advance widths of DejaVu Sans, in thousandths of the size (the font's own table).
WIDTHS = {
    **{c: 636 for c in "0123456789"},
    ".": 318,
    ",": 318,
    " ": 318,
    "=": 838,
    "_": 500,
    "-": 361,
    "(": 390,
    ")": 390,
    "[": 390,
    "]": 390,
    "h": 634,
    "f": 352,
    "p": 635,
    "e": 615,
    "w": 818,
    "s": 521,
    "v": 592,
    "t": 392,
    "m": 974,
    "i": 278,
    "n": 634,
    "W": 989,
    "l": 278,
    "c": 550,
    "o": 612,
    "r": 411,
    "g": 635,
    "d": 635,
    "a": 613,
    "L": 557,
    "E": 632,
    "D": 770,
    "S": 635,
    "F": 575,
    "θ": 612,
}


def picture(svg):
    """Of a drawing: its labels with the boxes that they fill, all its lines and edges, and its width."""
    labels, lines = [], []
    drawing = xml.etree.ElementTree.fromstring(svg)
    for e in drawing.iter():
        tag = e.tag.split("}")[1]
        if tag == "line":
            lines.append(tuple(float(e.get(k)) for k in ["x1", "y1", "x2", "y2"]))
        elif tag == "path":
            for loop in e.get("d").split("Z")[:-1]:
                points = [tuple(float(v) for v in p.split()) for p in re.split("[ML]", loop)[1:]]
                lines += [a + b for a, b in zip(points, points[1:] + points[:1])]
        elif tag == "text":
            size, x, y = (float(e.get(k)) for k in ["font-size", "x", "y"])
            length = sum(WIDTHS[c] for c in e.text) * size / 1000 * (1.15 if e.get("font-weight") else 1)
            left = {"start": x, "middle": x - length / 2, "end": x - length}[e.get("text-anchor")]
            labels.append((e.text, (left, y - 0.73 * size, left + length, y + 0.24 * size)))
    return labels, lines, float(drawing.get("width"))


def passes_through(line, box):
    """By points along the line, a quarter of a pixel apart."""
    x1, y1, x2, y2 = line
    steps = int(4 * max(abs(x2 - x1), abs(y2 - y1))) + 1
    return any(
        box[0] < x1 + (x2 - x1) * k / steps < box[2] and box[1] < y1 + (y2 - y1) * k / steps < box[3]
        for k in range(steps + 1)
    )


class Refusals(unittest.TestCase):
    """Every malformed request: its exit code, one line on standard error that names the culprit, nothing on standard
    output, no files."""

    def refused(self, code, words, *arguments):
        with self.subTest(" ".join(arguments)), tempfile.TemporaryDirectory() as folder:
            done = run(*arguments, cwd=folder)
            check_refusal(self, done, code, words)
            self.assertEqual(os.listdir(folder), [])

    def bad_store(self, words, *arguments):  # where the build lacks SQLite, the refusal names the build
        on = [c["name"] for c in json.loads(run("doctor", "--json").stdout)["components"] if c["on"]]
        if "SQLite" in on:
            self.refused(BAD_FILE, words, *arguments)
        else:
            self.refused(FAULT, ["was built without a library", "lumo doctor"], *arguments)

    def test_commands(self):
        self.refused(USAGE, ["command"])
        self.refused(USAGE, ["pres", "unknown command"], "pres")
        self.refused(USAGE, ["--frobnicate"], "--frobnicate")
        for command in DESIGN_COMMANDS + ["doctor"]:
            self.refused(USAGE, ["--frobnicate", "unknown option", f"lumo {command} --help"], command, "--frobnicate")
            log = ["log"] if command == "doctor" else []  # which it may be asked about
            self.refused(USAGE, ["'extra'"], command, *log, "extra")
        self.refused(USAGE, ["--theta"], "doctor", "--theta", "6,6,8,5,0")
        self.refused(USAGE, ["--diameter"], "evaluate", "--diameter", "10")
        self.refused(USAGE, ["--ensemble"], "press", "--ensemble", "flat")

    def test_campaign(self):
        self.refused(USAGE, ["no command", "lumo campaign --help"], "campaign")
        self.refused(USAGE, ["unknown command", "'go'"], "campaign", "go")
        for command in ["run", "status", "verify", "export", "select", "report"]:
            self.refused(USAGE, ["--store is missing", f"lumo campaign {command} --help"], "campaign", command)
            self.refused(USAGE, ["--frobnicate", "unknown option"], "campaign", command, "--store", "s", "--frobnicate")
        for command in ["status", "verify", "export", "select", "report"]:
            self.bad_store(["missing"], "campaign", command, "--store", "missing")
            self.refused(USAGE, ["--material"], "campaign", command, "--store", "s", "--material", "DS")
        self.refused(USAGE, ["--evaluations", "1 to 100000"], "campaign", "run", "--store", "s", "--evaluations", "0")
        self.refused(USAGE, ["--pending", "1 to 1000"], "campaign", "run", "--store", "s", "--pending", "0")
        self.refused(USAGE, ["--source", "default or paper"], "campaign", "run", "--store", "s", "--source", "best")
        self.bad_store(["no/such/folder"], "campaign", "run", "--store", "no/such/folder/s")
        self.refused(USAGE, ["--store", "2 times"], "campaign", "status", "--store", "s", "--store", "t")
        self.refused(USAGE, ["--seeds", "1 to 1000"], "campaign", "select", "--store", "s", "--seeds", "0")

    def test_cameras(self):
        for option, words, texts in [
            ("--distance", ["[10, 10000]", "mm"], ["9", "-250", "1e6"]),
            ("--pitch", ["[-10, 89]", "deg"], ["90", "-11"]),
            ("--yaw", ["[-80, 80]", "deg"], ["81"]),
            ("--focal", ["px"], ["0", "-3"]),
            ("--fov", ["[0.1, 170]", "deg"], ["0", "171"]),
            ("--aperture", ["mm"], ["0"]),
            ("--exposure", ["ms"], ["0", "-1"]),
            ("--gain", ["[0.01, 10000]"], ["0"]),
            ("--range", ["1/(m2 sr)"], ["0"]),
        ]:
            for text in texts:
                self.refused(USAGE, [option, f"'{text}'", *words], "render", option, text)
            for text in ["nan", "inf", "much"]:
                self.refused(USAGE, [option, "number"], "render", option, text)
        for text in ["0", "3", "12", "65537", "-8"]:
            self.refused(USAGE, ["samples", text], "render", "--samples", text)
        self.refused(USAGE, ["--pixels", "columns,rows"], "render", "--pixels", "640")
        self.refused(USAGE, ["--pixels", "1 to 4096"], "render", "--pixels", "640,0")
        self.refused(USAGE, ["--observe", "side or camera or photodiodes"], "evaluate", "--observe", "eye")
        self.refused(USAGE, ["observation.by", "side"], "trace", "--set", "observation.by=camera")

    def test_study(self):
        self.refused(USAGE, ["no command", "lumo study --help"], "study")
        self.refused(USAGE, ["unknown command", "'all'"], "study", "all")
        for command in ["carrier", "void", "readings"]:
            self.refused(USAGE, ["--frobnicate", f"lumo study {command} --help"], "study", command, "--frobnicate")
            self.refused(USAGE, ["--designs", "1 to 500"], "study", command, "--designs", "none")
            self.refused(USAGE, ["--designs", "501"], "study", command, "--designs", "501")
            self.refused(USAGE, ["--ensemble", "flat or curved"], "study", command, "--ensemble", "middle")
            self.bad_store(["no/such/folder"], "study", command, "--store", "no/such/folder/s")
            self.refused(BAD_FILE, ["not a directory"], "study", command, "--out", "/dev/null/x")

        self.refused(USAGE, ["--coarse"], "study", "readings", "--coarse=2")
        self.refused(USAGE, ["--coarse"], "study", "void", "--coarse")

    def test_mechanics(self):
        for command in ["press", "trace", "evaluate"]:
            for option, wanted, texts in [
                ("--solver", "quasi_static or vbd", ["newton", "VBD", ""]),
                ("--element", "linear or quadratic", ["cubic", ""]),
                ("--law", "neo_hookean or newton", ["yeoh", ""]),
                ("--contact-points", "surface or vertex", ["face", ""]),
                ("--mode", "default or paper", ["Paper", ""]),
            ]:
                for text in texts:
                    self.refused(USAGE, [option] + ([wanted] if text else []), command, option, text)
            for option, words, texts in [
                ("--size", ["0.2", "10", "mm"], ["0", "0.1", "11", "-1"]),
                ("--friction", ["[0, 10]"], ["-0.1", "11"]),
                ("--contact-stiffness", ["N/m3"], ["0", "1e5", "1e16"]),
            ]:
                for text in texts:
                    self.refused(USAGE, [option, f"'{text}'", *words], command, option, text)
                for text in ["nan", "inf", "much", "1,2"]:
                    self.refused(USAGE, [option, "number"], command, option, text)
            for text in ["0", "-1", "1.5", "nan", "1e3", "1000001"]:
                self.refused(USAGE, ["--sweeps", "1 to 1000000"], command, "--mode", "paper", "--sweeps", text)
            # Options that make no sense together.
            self.refused(USAGE, ["--sweeps", "--solver vbd"], command, "--sweeps", "10")
            for option, value, own in [
                ("--solver", "quasi_static", "vbd"),
                ("--element", "quadratic", "linear"),
                ("--law", "neo_hookean", "newton"),
            ]:
                self.refused(USAGE, [option, value, "mode paper", own], command, "--mode", "paper", option, value)
        for command in [["evaluate"], ["campaign", "run", "--store", "s"]]:
            for text in ["0", "-1", "101", "nan", "little"]:
                self.refused(USAGE, ["--ray-error", f"'{text}'"], *command, "--ray-error", text)
        self.refused(USAGE, ["unknown option '--ray-error'"], "trace", "--ray-error", "2")
        self.refused(
            INFEASIBLE, [], "evaluate", "--solver", "vbd", "--theta", "1,1,1,1,1"
        )  # the solver is asked for, what it holds is scored
        for command in ["section", "mesh"]:
            self.refused(USAGE, ["unknown option '--solver'"], command, "--solver", "vbd")
        self.refused(USAGE, ["unknown option '--solver'"], "campaign", "run", "--store", "s", "--solver", "vbd")
        self.refused(USAGE, ["default or paper"], "campaign", "run", "--store", "s", "--mode", "fast")

    def test_study_of_solvers(self):
        self.refused(USAGE, ["--frobnicate", "lumo study solver --help"], "study", "solver", "--frobnicate")
        for option, value in [
            ("--solver", "vbd"),
            ("--element", "linear"),
            ("--sweeps", "10"),
            ("--mode", "paper"),
            ("--store", "s"),
        ]:
            self.refused(USAGE, [f"unknown option '{option}'"], "study", "solver", option, value)
        self.refused(USAGE, ["--size", "mm"], "study", "solver", "--size", "0.1")
        self.refused(USAGE, ["increasing loads"], "study", "solver", "--loads", "2,1")
        self.refused(INFEASIBLE, ["t_min"], "study", "solver", "--theta", "2,6,8,5,0")
        self.refused(BAD_FILE, ["not a directory"], "study", "solver", "--out", "/dev/null/x")

    def test_flags_and_values(self):
        self.refused(USAGE, ["'--json'", "must follow the command"], "--json", "section")
        self.refused(USAGE, ["unknown option '--theta'"], "section", "--", "--theta")
        for option in ["--out", "--theta"]:
            self.refused(USAGE, [option, "needs a value"], "section", option, "--json")
            self.refused(
                USAGE, [f"{option} is '', must have a value", "(see lumo section --help)"], "section", option, ""
            )
            self.refused(USAGE, [f"{option} has no value", "(see lumo section --help)"], "section", option)
            self.refused(USAGE, [f"{option} has no value"], "section", "--json", f"{option}=")
        for value in ["--json=5", "--json=false", "--quiet=1"]:
            self.refused(
                USAGE, [value.split("=")[0] + " takes no value", "(see lumo section --help)"], "section", value
            )
        for times in [2, 3]:
            self.refused(
                USAGE,
                [f"--theta is given {times} times, must be given once", "(see lumo section --help)"],
                "section",
                *times * ["--theta", "6,6,8,5,0"],
            )
        self.refused(USAGE, ["--loads has no value", "(see lumo press --help)"], "press", "--loads")
        self.refused(
            USAGE,
            ["--seed is given 2 times", "(see lumo campaign run --help)"],
            "campaign",
            "run",
            "--store",
            "s",
            "--seed",
            "1",
            "--seed",
            "2",
        )
        self.refused(
            USAGE, ["--store has no value", "(see lumo campaign report --help)"], "campaign", "report", "--store"
        )
        self.refused(
            USAGE,
            ["--json and --csv exclude each other", "(see lumo campaign export --help)"],
            "campaign",
            "export",
            "--store",
            "s",
            "--csv",
            "--json",
        )

    def test_closed_streams(self):
        with tempfile.TemporaryDirectory() as folder:
            space = pathlib.Path(folder) / "space.json"
            space.write_text(
                json.dumps(
                    {
                        "variables": [{"name": "a", "lower": 0, "upper": 1}],
                        "objectives": [{"name": "f", "goal": "maximize", "reference": 0}],
                        "sobol": 2,
                        "evaluations": 3,
                    }
                )
            )
            done = subprocess.run(
                f"'{LUMO}' optimize --space space.json --transcript t >&- </dev/null",
                shell=True,
                cwd=folder,
                capture_output=True,
                text=True,
                timeout=60,
            )
            self.assertEqual(done.returncode, BAD_FILE)
            self.assertIn("cannot write to standard output", done.stderr)
            self.assertEqual(
                [list(json.loads(line)) for line in (pathlib.Path(folder) / "t").read_text().splitlines()],
                [["space", "digest"], ["ask", "digest"]],
            )
            done = subprocess.run(
                f"'{LUMO}' mesh --json 2>&-", shell=True, cwd=folder, capture_output=True, text=True, timeout=60
            )
            self.assertEqual(done.returncode, 0)
            json.loads(done.stdout)

    def test_theta_is_five_numbers(self):
        for text in [
            "6",
            "6,6,8,5",
            "6,6,8,5,0,1",
            "a,b,c,d,e",
            "6,6,8,5,",
            ",6,8,5,0",
            "6;6;8;5;0",
            "6 6 8 5 0",
            "6,6,8,5,0x",
            "6,6,8,5,0 ",
            "0x6,6,8,5,0",
            "6,6,8,5,1e",
            "6,6,8,5,--1",
            "6,6,8,5,+-1",
            "6.,6,8,5,0.5.5",
        ]:
            self.refused(USAGE, ["--theta", "five numbers"], "section", "--theta", text)
        self.refused(USAGE, ["--theta"], "section", "--theta", "")
        self.refused(USAGE, ["--theta"], "section", "--theta=")
        self.refused(USAGE, ["--theta"], "section", "--theta")
        self.refused(USAGE, ["--theta"], "section", "--theta", "6,6,8,5,0", "--theta", "6,6,8,5,0")
        self.refused(USAGE, ["--theta"], "section", "--theta", "6,6,8,5\n,0,1")

    def test_infeasible_designs(self):
        for command in DESIGN_COMMANDS:
            self.refused(INFEASIBLE, ["h_fp", "6.25", "0.5", "mm"], command, "--theta", "6.25,6,8,5,0")
        for text, words in [
            ("nan,6,8,5,0", ["h_fp = nan mm", "[2, 29] mm"]),
            ("-nan,6,8,5,0", ["h_fp = nan mm"]),
            ("6,-inf,8,5,0", ["h_ep = -inf mm", "[1, 20] mm"]),
            ("6.00000000000001,6,8,5,0", ["6.00000000000001 mm", "nearest is 6 mm"]),
            ("6,inf,8,5,0", ["h_ep"]),
            ("6,6,-inf,5,0", ["w_s"]),
            ("6,6,8,5,1e999", ["w_v"]),
            ("NaN,6,8,5,0", ["h_fp"]),
            ("1.5,6,8,5,0", ["h_fp", "1.5", "2", "mm"]),
            ("29.5,1,8,5,0", ["h_fp", "29.5", "29"]),
            ("6,6,8,5,-0.5", ["w_v", "-0.5", "0"]),
            ("12,9,8,5,0", ["h_fp + h_ep", "21", "20"]),
            ("10,8,8,5,6", ["w_s + 2 w_v", "20", "19.5"]),
            ("2,6,8,5,0", ["t_min", "5"]),
        ]:
            self.refused(INFEASIBLE, words, "section", "--theta", text)

    def test_usage_comes_before_feasibility(self):
        self.refused(USAGE, ["--threads"], "section", "--theta", "nan,6,8,5,0", "--threads", "0")

    def test_threads(self):
        for text in ["0", "-1", "1025", "1.5", "two", "", "1e3", "99999999999999999999", " 2", "nan"]:
            self.refused(USAGE, ["--threads"] + (["1024"] if text else []), "evaluate", "--threads", text)

    def test_names(self):
        for text in ["ds", "Dragon", "", "DS "]:
            self.refused(USAGE, ["--material"], "press", "--material", text)
        for text in ["round", "", "Flat"]:
            self.refused(USAGE, ["--ensemble"], "evaluate", "--ensemble", text)

    def test_scenario(self):
        for command in ["press", "trace"]:
            for option, unit, texts in [
                ("--diameter", "mm", ["0", "-10", "nan", "inf", "ten", "10mm", "10,5", "1e9", "", "1001"]),
                ("--angle", "deg", ["nan", "inf", "81", "-80.5", "x", ""]),
                ("--x", "mm", ["nan", "1e6", ""]),
                ("--y", "mm", ["nan", "-inf", "1e6", "0,0", ""]),
                ("--time-limit", "s", ["0", "-1", "nan", "inf", "1e10", "soon", ""]),
                ("--loads", "N", ["0", "-1", "nan", "inf", "5,2", "1,1", "1,,2", "1,2,", "one", "1e9", ""]),
            ]:
                for text in texts:
                    self.refused(USAGE, [option, f"'{text}'"] + ([unit] if text else []), command, option, text)
            # The value as typed, the limits in its unit.
            for option, text, words in [
                ("--angle", "1e308", ["'1e308'", "[-80, 80] deg"]),
                ("--angle", "80.0001", ["'80.0001'"]),
                ("--diameter", "1e-9", ["'1e-9'", "[0.1, 1000] mm"]),
                ("--y", "1e300", ["'1e300'", "[-10000, 10000] mm"]),
                ("--loads", "1,,2", ["'1,,2'", "field 2 of 3", "''", "[N]"]),
                ("--loads", "1,two", ["'1,two'", "field 2 of 2", "'two'"]),
                ("--loads", "1,1e9", ["'1,1e9'", "field 2", "'1e9'", "[0.001, 10000] N"]),
                ("--loads", "2,5,4", ["field 3", "'4'", "5 N", "increasing loads"]),
            ]:
                self.refused(USAGE, [option, *words], command, option, text)
            for text in ["nan", "much"]:  # without a unit no brackets for one
                done = run(command, "--friction", text)
                self.assertRegex(done.stderr, rf"^lumo: --friction is '{text}', must be a (finite )?number\n$")
            # The limits themselves are the library's, too.
            for option, text in [
                ("--angle", "80"),
                ("--angle", "-80"),
                ("--diameter", "0.1"),
                ("--diameter", "1000"),
                ("--y", "1e4"),
                ("--y", "-1e4"),
                ("--loads", "0.001,10000"),
            ]:
                self.refused(BAD_FILE, ["not a directory"], command, option, text, "--out", "/dev/null/x")
        self.refused(
            USAGE, ["--noise is '101', must lie in [0, 100]"], "lab", "force", "--out", "log", "--noise", "101"
        )

    def test_out(self):
        with tempfile.NamedTemporaryFile() as file:
            for command in DESIGN_COMMANDS:
                self.refused(BAD_FILE, [file.name, "not a directory"], command, "--out", file.name)
                self.refused(BAD_FILE, ["part of it is not a directory"], command, "--out", file.name + "/below")
            with tempfile.TemporaryDirectory() as folder:
                link = os.path.join(folder, "link")
                os.symlink("nowhere", link)
                for path in [file.name, file.name + "/", "/dev/null", link, link + "/"]:
                    self.refused(BAD_FILE, [f"'{path}': it is not a directory"], "section", "--out", path)
                self.refused(BAD_FILE, ["part of it is not a directory"], "section", "--out", link + "/below")
                self.assertEqual(os.listdir(folder), ["link"])
        self.refused(USAGE, ["--out"], "section", "--out", "")

    @unittest.skipIf(os.geteuid() == 0, "root may write anywhere")
    def test_out_without_rights(self):
        self.refused(BAD_FILE, ["Permission denied"], "section", "--out", "/proc/1/lumo")

    def test_infeasible_comes_before_out(self):
        self.refused(INFEASIBLE, ["h_fp"], "section", "--theta", "1,6,8,5,0", "--out", "/dev/null/x")

    def test_messages_stay_one_line_whatever_is_typed(self):
        self.refused(USAGE, ["--theta"], "section", "--theta", "a\nb\tc\x1b[31m")
        self.refused(USAGE, [], "x" * 5000)


class Answers(unittest.TestCase):
    def test_help_and_version(self):
        for arguments in [["--help"], ["press", "--help"], ["doctor", "-h"], ["--version"]]:
            done = run(*arguments)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            self.assertTrue(done.stdout.strip())
        self.assertIn("--diameter", run("press", "--help").stdout)
        self.assertRegex(run("--version").stdout, r"^lumo \d+\.\d+\.\d+, results \d+\n$")

    def test_standard_output_must_hold(self):
        with open("/dev/full", "w") as full:
            done = subprocess.run([LUMO, "doctor"], stdout=full, stderr=subprocess.PIPE, text=True)
        self.assertEqual(done.returncode, BAD_FILE)
        self.assertEqual(done.stderr, "lumo: cannot write to standard output: No space left on device\n")

    def test_a_reader_who_has_seen_enough_is_no_failure(self):
        with tempfile.TemporaryDirectory() as folder:
            for arguments, files in [
                (["section"], []),
                (["section", "--json"], []),
                (["doctor"], []),
                (["--help"], []),
                (["section", "--quiet", "--out", "."], ["section.svg"]),
            ]:
                with self.subTest(" ".join(arguments)):
                    read, write = os.pipe()
                    os.close(read)
                    done = subprocess.run(
                        [LUMO, *arguments], cwd=folder, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60
                    )
                    os.close(write)
                    self.assertEqual((done.returncode, done.stderr, os.listdir(folder)), (0, "", files))
            # What failed stays failed.
            read, write = os.pipe()
            os.close(read)
            os.mkdir(os.path.join(folder, "taken"))
            os.mkdir(os.path.join(folder, "taken", "section.svg"))
            done = subprocess.run(
                [LUMO, "section", "--out", "taken"],
                cwd=folder,
                stdout=write,
                stderr=subprocess.PIPE,
                text=True,
                timeout=60,
            )
            os.close(write)
            self.assertEqual(done.returncode, BAD_FILE)
            self.assertIn("is a directory", done.stderr)

    def test_doctor(self):
        done = run("doctor", "--json")
        self.assertEqual(done.returncode, 0)
        report = json.loads(done.stdout)
        names = [c["name"] for c in report["components"]]
        for name in [
            "Eigen",
            "TetGen",
            "Embree",
            "CHOLMOD",
            "BLAS",
            "oneTBB",
            "SQLite",
            "xxHash",
            "plotly.js",
            "OpenCV",
            "libzip",
            "LZ4",
            "Zstandard",
            "CLI11",
            "nlohmann-json",
        ]:
            self.assertIn(name, names)
        off = [c for c in report["components"] if not c["on"]]
        for component, line in zip(off, report["off"], strict=True):
            self.assertTrue(line.startswith(component["name"]) and component["package"] in line, line)
        for component in report["components"]:
            self.assertTrue(component["package"])
            self.assertEqual(component["version"] is not None, component["on"], component)
        self.assertIn("Eigen", run("doctor").stdout)

    def test_without_the_module_beside_it(
        self,
    ):  # that of OpenCV, for commands on pictures; where the build lacks a library, its package is named
        with tempfile.TemporaryDirectory() as folder:
            alone = shutil.copy(LUMO, folder)
            for arguments in [["decode", "log"], ["lab", "force", "--out", "log"], ["doctor", "--camera", "0"]]:
                done = subprocess.run([alone, *arguments], cwd=folder, capture_output=True, text=True, timeout=60)
                self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (FAULT, "", 1), done.stderr)
                self.assertRegex(done.stderr, f"OpenCV: '{folder}/lumo-opencv.so' is missing.*libopencv-dev|needs: lib")
            self.assertEqual(
                subprocess.run([alone, "section"], cwd=folder, capture_output=True, timeout=60).returncode, 0
            )
            self.assertEqual(os.listdir(folder), [os.path.basename(LUMO)])

    def test_section(self):
        done = run("section", "--theta", "5,10,10,6,3")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        drawing = xml.etree.ElementTree.fromstring(done.stdout)
        words = [t.text for t in drawing.iter("{http://www.w3.org/2000/svg}text")]
        for label in ["h_fp = 5 mm", "h_ep = 10 mm", "w_s = 10 mm", "h_s = 6 mm", "w_v = 3 mm", "W = 30 mm"]:
            self.assertIn(label, words)
        report = json.loads(run("section", "--json", "--theta", "+5,1e1,10,6.0,3").stdout)
        self.assertEqual(report["theta_mm"], [5, 10, 10, 6, 3])
        self.assertEqual(report["dimensions_mm"]["W"], 30)
        plain = json.loads(run("section", "--json", "--finger", "plain", "--theta", "5,10,10,6,3").stdout)
        self.assertEqual(plain["dimensions_mm"]["W"], 29.5)

    def test_section_labels_keep_off_lines(self):
        for finger in ["built", "plain"]:
            self.labels_keep_off_lines(finger)

    def labels_keep_off_lines(self, finger):
        designs = [
            "8,4,4,4,2",
            "3,12,15,2.5,2",
            "5,10,10,6,3",
            "6,6,8,5,0",
            "10,8,4.5,4,7.5",
            "12,8,8,5,0.5",
            "9,1,8,3,2.5",
            "2,16,8,4.5,1",
            "6.5,12.5,15,12,0.5",
            "19,1,15,2,2",
        ]
        if finger == "built":  # some lie too near its surface
            designs = ["5,9,7.6,6,2", "8,1.5,9,4,5", "14.5,4,5,12.5,5", "2.5,17.5,7,2,3.5", "13,7,7.5,14.5,0"]
        chance, drawn = random.Random(1), 0
        for theta in designs + [
            ",".join(
                str(chance.randint(2 * low, 2 * high) / 2) for low, high in [(2, 18), (1, 18), (4, 15), (2, 10), (0, 7)]
            )
            for _ in range(80)
        ]:
            done = run("section", "--finger", finger, "--theta", theta)
            if theta not in designs and done.returncode == INFEASIBLE:
                continue
            with self.subTest(finger + " " + theta):
                self.assertEqual(done.returncode, 0, done.stderr)
                drawn += 1
                labels, lines, width = picture(done.stdout)
                self.assertGreaterEqual(sum("=" in words and "θ" not in words for words, _ in labels), 6)
                for number, (words, box) in enumerate(labels):
                    for line in lines:
                        self.assertFalse(passes_through(line, box), f"{words} {box} is crossed by {line}")
                    for other, another in labels[:number]:
                        self.assertFalse(
                            box[0] < another[2] and another[0] < box[2] and box[1] < another[3] and another[1] < box[3],
                            f"{words} runs over {other}",
                        )
                    self.assertTrue(0 < box[0] and box[2] < width, words)
        self.assertGreater(drawn, 25)

    def test_a_design_on_the_lattice_but_for_rounding_is_that_design(self):
        for text in [
            "6.0000000000000009,6,8,5,0",
            "6,5.999999999999999,8.000000000000002,5,0",
            "5.9999999999999991,6,8,5,-0.0",
        ]:
            for arguments in [["--json"], []]:
                self.assertEqual(
                    run("section", *arguments, "--theta", text).stdout,
                    run("section", *arguments, "--theta", "6,6,8,5,0").stdout,
                )

    def test_exact_wall_is_feasible(self):
        self.assertEqual(run("section", "--finger", "plain", "--theta", "10,8,4.5,4,7.5").returncode, 0)

    def test_out_is_made_and_complete(self):
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "new" / "deeper"
            done = run("section", "--out", str(out))
            self.assertEqual(done.returncode, 0)
            self.assertEqual(os.listdir(out), ["section.svg"])
            self.assertIn("section.svg", done.stderr)
            self.assertEqual(run("section", "--out", str(out), "--quiet").stderr, "")

    def test_numbers_do_not_follow_the_locale(self):
        self.assertEqual(
            run("section", "--json", "--theta", "6,6,8,5,0.5", locale="de_DE.UTF-8").stdout,
            run("section", "--json", "--theta", "6,6,8,5,0.5").stdout,
        )


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
