"""What the commands compute, seen from outside: every promised key, sound files, one answer for any number of threads,
a clean stop.

usage: test_results.py path/to/lumo [quick|long]
"""

import base64
import csv
import json
import math
import os
import pathlib
import pty
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import xml.etree.ElementTree

LUMO, LONG = "", False
COMPUTE = ["mesh", "press", "trace", "render", "evaluate", "study"]
STATE = [
    "load_N",
    "force_N",
    "depth_mm",
    "contact_area_mm2",
    "reference_area_mm2",
    "residual_N",
    "penetration_mm",
    "response",
    "response_change_err",
    "depth_err_mm",
    "contact_area_err_mm2",
]
SCENARIO = ["diameter_mm", "angle_deg", "y_mm", "status", "q_form", "q_stable", "q_stiff", "states"]
EVALUATION = [
    "theta_mm",
    "material",
    "mechanics",
    "ensemble",
    "J_contact",
    "J_contact_err",
    "J_obs",
    "J_obs_err",
    "worst_contact",
    "worst_observation",
    "unloaded_response",
    "unloaded_response_err",
    "scenarios",
    "ledger",
    "mesh",
    "seconds",
    "configuration",
]


MECHANICS = {
    "mode": "default",
    "solver": "quasi_static",
    "element": "quadratic",
    "size_mm": None,
    "sweeps": None,
    "law": "neo_hookean",
    "contact_stiffness_N_per_m3": 1e11,
    "contact_points": "surface",
    "friction": 0,
}
STUDIED = ["name", "mechanics", "mesh", "status", "q_form", "q_stable", "q_stiff", "score", "seconds", "states"]


def run(*arguments, timeout=900, finger="plain"):
    """Of a plain finger unless another is asked for: it is pressed in a fraction of the time."""
    chosen = ["--finger", finger] if arguments[0] in COMPUTE else []
    return subprocess.run([LUMO, *arguments, *chosen], capture_output=True, text=True, timeout=timeout)


def strict(text):
    """JSON without the NaN that Python would let pass."""

    def refuse(word):
        raise ValueError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


def read_arrays(path):
    """Sizes and name → numbers of a .vtu file: UInt64 byte count, then little-endian values, all in one base64
    piece."""
    formats = {"Float64": "d", "Int64": "q", "UInt8": "B"}
    piece = xml.etree.ElementTree.parse(path).getroot().find("UnstructuredGrid/Piece")
    arrays = {}
    for array in piece.iter("DataArray"):
        data = base64.b64decode(array.text, validate=True)
        (size,) = struct.unpack("<Q", data[:8])
        if size != len(data) - 8:
            raise ValueError(f"{array.get('Name')}: {size} bytes announced, {len(data) - 8} found")
        code = formats[array.get("type")]
        arrays[array.get("Name")] = struct.unpack(f"<{size // struct.calcsize(code)}{code}", data[8:])
    return int(piece.get("NumberOfPoints")), int(piece.get("NumberOfCells")), arrays


def without_times(report):
    report.pop("seconds", None)
    return report


class Quick(unittest.TestCase):
    def good(self, *arguments, **options):
        done = run(*arguments, **options)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done

    def test_mesh(self):
        with tempfile.TemporaryDirectory() as folder:
            report = strict(self.good("mesh", "--json", "--out", folder).stdout)
            points, cells, arrays = read_arrays(pathlib.Path(folder) / "mesh.vtu")
        self.assertEqual((points, cells), (report["mesh"]["nodes"], report["mesh"]["elements"]))
        self.assertEqual(len(arrays["position_m"]), 3 * points)
        self.assertEqual(set(arrays["types"]), {24})
        self.assertEqual(len(arrays["connectivity"]), 10 * cells)
        self.assertEqual((min(arrays["connectivity"]), max(arrays["connectivity"])), (0, points - 1))
        # Straight or curved, an edge's middle node lies near the middle of its ends: the node order is VTK's.
        node = lambda i: arrays["position_m"][3 * i : 3 * i + 3]
        for cell in range(0, cells, max(1, cells // 200)):
            nodes = arrays["connectivity"][10 * cell : 10 * cell + 10]
            for k, (a, b) in enumerate([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]):
                ends, middle = (node(nodes[a]), node(nodes[b])), node(nodes[4 + k])
                self.assertLess(math.dist(middle, [(p + q) / 2 for p, q in zip(*ends)]), 0.25 * math.dist(*ends))

    def test_press(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.good("press", "--json", "--loads", "1,2", "--out", folder)
            report = strict(done.stdout)
            written = set(os.listdir(folder))
            points, _, arrays = read_arrays(pathlib.Path(folder) / "press_2.vtu")
            with open(pathlib.Path(folder) / "press.csv", newline="") as file:
                table = list(csv.DictReader(file))
            with open(pathlib.Path(folder) / "traction.csv", newline="") as file:
                tractions = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
            for picture in ["force_depth.svg", "contact.svg"]:
                xml.etree.ElementTree.parse(pathlib.Path(folder) / picture)
        self.assertEqual(report["mechanics"], MECHANICS)
        self.assertEqual(
            written,
            {"force_depth.svg", "contact.svg", "press.csv", "traction.csv", "press.pvd", "press_1.vtu", "press_2.vtu"},
        )
        for key in SCENARIO:
            self.assertIn(key, report)
        self.assertEqual([s["load_N"] for s in report["states"]], [1, 2])
        for state in report["states"]:
            self.assertEqual(set(state), set(STATE))
            self.assertIsNone(state["response"])
            self.assertAlmostEqual(state["force_N"], state["load_N"], delta=1e-3 * state["load_N"])
            self.assertTrue(0 < state["penetration_mm"] < 0.01 * state["depth_mm"], state)
        depths = [s["depth_mm"] for s in report["states"]]
        self.assertLess(depths[0], depths[1])
        self.assertIsNone(report["q_stiff"])  # needs loads that were not given
        self.assertEqual(
            [float(row["penetration_mm"]) for row in table],
            [float(f"{s['penetration_mm']:.12g}") for s in report["states"]],
        )
        self.assertEqual(len(arrays["displacement_m"]), 3 * points)
        lowest = min(arrays["displacement_m"][2::3])
        self.assertLess(lowest, -0.5e-3 * depths[1])
        for state in report["states"]:  # the sphere comes along -z; kPa mm2 is 1e-3 N
            rows = [row for row in tractions if row["load_N"] == state["load_N"]]
            push = -1e-3 * sum(row["area_mm2"] * row["traction_z_kPa"] for row in rows)
            self.assertAlmostEqual(push, state["load_N"], delta=1e-6 * state["load_N"])
        self.assertEqual(len(arrays["traction_Pa"]), 3 * points)
        self.assertEqual(len(arrays["pressure_Pa"]), points)
        self.assertTrue(
            min(arrays["pressure_Pa"]) == 0
            and max(arrays["pressure_Pa"])
            > report["states"][1]["load_N"] / (1e-6 * report["states"][1]["contact_area_mm2"])
        )
        field = arrays["contact_field_m"]
        self.assertTrue(all(map(math.isfinite, field)) and min(field) < 0 < max(field))  # outside, inside the contact

    def test_a_contact_comes_back_as_typed(self):
        for angle in (-30, 15):
            done = self.good(
                "press",
                "--mode",
                "paper",
                "--size",
                "5",
                "--sweeps",
                "2",
                "--loads",
                "1",
                "--angle",
                str(angle),
                "--y",
                "-11",
                "--json",
            )
            report = strict(done.stdout)
            self.assertEqual([report["diameter_mm"], report["angle_deg"], report["y_mm"]], [10, angle, -11])

    def test_the_finger_as_built(self):
        with tempfile.TemporaryDirectory() as folder:
            report = strict(self.good("trace", "--json", "--loads", "1", "--out", folder, finger="built").stdout)
            for picture in pathlib.Path(folder).glob("*.svg"):
                xml.etree.ElementTree.parse(picture)
        self.assertEqual(report["theta_mm"], [5, 9, 7.6, 6, 2])
        self.assertEqual(report["configuration"]["finger"]["stem"], "free")
        (state,) = report["states"]
        self.assertEqual(report["status"], "converged")
        self.assertAlmostEqual(state["depth_mm"], 0.846, delta=0.015)
        self.assertTrue(all(r > 0 for r in report["unloaded_response"]))
        plain = strict(self.good("mesh", "--json").stdout)
        self.assertEqual(plain["theta_mm"], [6, 6, 8, 5, 0])
        built = strict(self.good("mesh", "--json", finger="built").stdout)
        self.assertLess(plain["mesh"]["nodes"], built["mesh"]["nodes"])

    def test_no_equilibrium(self):
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, "out")
            done = run("press", "--diameter", "2", "--loads", "1,900", "--json", "--out", out)
            self.assertEqual(os.listdir(folder), [])  # files are for good results only
        self.assertEqual(done.returncode, 4)
        report = strict(done.stdout)
        self.assertNotEqual(report["status"], "converged")
        self.assertGreater(report["states"][0]["depth_mm"], 0)
        self.assertIsNone(report["states"][1]["depth_mm"])
        self.assertEqual(
            [
                line.split(" (")[0].split(" in ")[0]
                for line in done.stderr.splitlines()
                if ("press" in line or "no eq" in line) and "factorisations" not in line  # these on slow machines only
            ],
            [
                "lumo: press ...",
                "lumo: press: done",
                "lumo: press again, finer ...",  # a press that is lost gets one finer mesh before that is said
                "lumo: press again, finer: done",
                "lumo: no equilibrium at 900 N",
            ],
        )

    def test_time_limit(self):
        done = run("press", "--angle", "80", "--diameter", "2", "--loads", "1", "--time-limit", "0.001", "--json")
        self.assertEqual(done.returncode, 4)
        self.assertEqual(strict(done.stdout)["status"], "time_limit")
        self.assertEqual(
            done.stderr.splitlines()[-1],
            "lumo: the time limit of 0.001 s ended the press (time_limit): no load was reached, not 1 N, "
            "sphere of 2 mm at 80 deg, y = 0 mm",
        )

    def test_files_of_an_earlier_press_stay(self):
        with tempfile.TemporaryDirectory() as folder:
            for loads in ["1,2", "1"]:
                self.good("press", "--loads", loads, "--out", folder)
            series = [
                entry.get("file")
                for entry in xml.etree.ElementTree.parse(pathlib.Path(folder) / "press.pvd").iter("DataSet")
            ]
            self.assertEqual(series, ["press_1.vtu"])  # of the last run
            self.assertTrue((pathlib.Path(folder) / "press_2.vtu").exists())

    def test_depths_of_the_model(
        self,
    ):  # quadratic elements, twice as many nodes; believed to the larger of 1.5 % and 15 µm
        for diameter, depths in ("10", [0.735, 1.114, 1.908, 2.864, 3.638]), (
            "30",
            [0.480, 0.706, 1.152, 1.653, 2.034],
        ):
            report = strict(self.good("press", "--diameter", diameter, "--json").stdout)
            for state, depth in zip(report["states"], depths, strict=True):
                self.assertAlmostEqual(state["depth_mm"], depth, delta=max(0.015 * depth, 0.015))

    def test_every_solver_element_law_and_contact(self):
        depths = {}
        for solver, element, size, law, points in [
            ("quasi_static", "linear", "4", "neo_hookean", "surface"),
            ("quasi_static", "linear", "4", "newton", "surface"),
            ("quasi_static", "linear", "4", "neo_hookean", "vertex"),
            ("quasi_static", "linear", "4", "newton", "vertex"),
            ("quasi_static", "quadratic", "6", "neo_hookean", "surface"),
            ("quasi_static", "quadratic", "6", "newton", "surface"),
            ("quasi_static", "quadratic", "6", "neo_hookean", "vertex"),
            ("quasi_static", "quadratic", "6", "newton", "vertex"),
            ("vbd", "linear", "4", "neo_hookean", "surface"),
            ("vbd", "linear", "4", "newton", "surface"),
            ("vbd", "linear", "4", "neo_hookean", "vertex"),
            ("vbd", "linear", "4", "newton", "vertex"),
            ("vbd", "quadratic", "8", "newton", "surface"),
        ]:
            sweeps = ["--sweeps", "3"] if solver == "vbd" else []
            report = strict(
                self.good(
                    "press",
                    "--json",
                    "--diameter",
                    "30",
                    "--loads",
                    "0.5",
                    "--solver",
                    solver,
                    "--element",
                    element,
                    "--size",
                    size,
                    "--law",
                    law,
                    *sweeps,
                    "--contact-points",
                    points,
                    "--contact-stiffness",
                    "1e10",
                    "--friction",
                    "0.2",
                ).stdout
            )
            with self.subTest((solver, element, law, points)):
                self.assertEqual(
                    report["mechanics"],
                    {
                        "mode": "default",
                        "solver": solver,
                        "element": element,
                        "size_mm": int(size),
                        "sweeps": 3 if sweeps else None,
                        "law": law,
                        "contact_stiffness_N_per_m3": 1e10,
                        "contact_points": points,
                        "friction": 0.2,
                    },
                )
                # On such edges areas may be unknown; forces and depths are not.
                self.assertIn(report["status"], ["held"] if sweeps else ["converged", "unresolved"])
                (state,) = report["states"]
                self.assertGreater(state["residual_N"], 0)
                if not sweeps:
                    self.assertAlmostEqual(state["force_N"], 0.5, delta=1e-6)
                    self.assertLessEqual(state["residual_N"], 1e-6 * state["load_N"])
                depths[solver, element, law, points] = state["depth_mm"]
        for law, points in [("neo_hookean", "surface"), ("newton", "surface")]:  # linear elements lock
            self.assertLess(
                depths["quasi_static", "linear", law, points], depths["quasi_static", "quadratic", law, points]
            )

    def test_a_solver_alone_does_not_change_the_contact(self):
        still, held = (
            strict(
                self.good(
                    "press", "--json", "--loads", "0.5", "--element", "linear", "--size", "5", "--solver", s
                ).stdout
            )["mechanics"]
            for s in ("quasi_static", "vbd")
        )
        self.assertEqual(
            {k: v for k, v in held.items() if k not in ("solver", "sweeps")},
            {k: v for k, v in still.items() if k not in ("solver", "sweeps")},
        )
        paper = strict(self.good("press", "--json", "--loads", "0.5", "--mode", "paper", "--size", "5").stdout)
        self.assertEqual(
            paper["mechanics"],
            {
                **MECHANICS,
                "mode": "paper",
                "solver": "vbd",
                "element": "linear",
                "size_mm": 5,
                "sweeps": 10,
                "law": "newton",
                "friction": 0.5,
            },
        )
        self.assertEqual(paper["status"], "held")
        smooth = strict(
            self.good("press", "--json", "--loads", "0.5", "--mode", "paper", "--size", "5", "--friction", "0").stdout
        )
        self.assertEqual(smooth["mechanics"], {**paper["mechanics"], "friction": 0})
        self.assertNotEqual(smooth["states"], paper["states"])
        one, two = (
            without_times(
                strict(
                    self.good(
                        "press", "--json", "--loads", "0.5", "--mode", "paper", "--size", "5", "--threads", n
                    ).stdout
                )
            )
            for n in "12"
        )
        self.assertEqual(one, two)

    def test_study_of_solvers(self):
        with tempfile.TemporaryDirectory() as folder:
            done = self.good(
                "study", "solver", "--size", "4", "--diameter", "20", "--loads", "1,2", "--json", "--out", folder
            )
            report = strict(done.stdout)
            self.assertEqual(set(os.listdir(folder)), {"study_solver.json", "study_solver.csv", "study_solver.html"})
            self.assertEqual((pathlib.Path(folder) / "study_solver.json").read_text(), done.stdout)
            page = (pathlib.Path(folder) / "study_solver.html").read_text()
            table = (pathlib.Path(folder) / "study_solver.csv").read_text().splitlines()
        self.assertEqual(len(table), 1 + 4 * 2)
        self.assertEqual(page.count("<svg"), 2)
        for elsewhere in ["<script", "http://", "https://", "<link"]:
            self.assertNotIn(elsewhere, page.replace("http://www.w3.org/2000/svg", ""))
        self.assertEqual(
            [r["name"] for r in report["rows"]],
            ["VBD, 10 sweeps", "VBD, 100 sweeps", "quasi-static, linear", "quasi-static, quadratic"],
        )
        few, many, linear, quadratic = report["rows"]
        for row in report["rows"]:
            self.assertEqual(list(row), STUDIED)
            self.assertEqual([s["load_N"] for s in row["states"]], [1, 2])
            if row["status"] != "unresolved":
                self.assertIsNotNone(row["q_form"])
            self.assertIsNone(row["q_stiff"])  # needs loads that were not given
            self.assertIn(row["name"], page)
        self.assertEqual([r["status"] for r in report["rows"][:2]], ["held", "held"])
        for row in report["rows"][2:]:
            self.assertIn(row["status"], ["converged", "unresolved"])  # edges of 4 mm
        self.assertEqual(len({json.dumps(r["mesh"]) for r in (few, many, linear)}), 1)
        for row in (linear, quadratic):
            for state in row["states"]:
                self.assertLessEqual(state["residual_over_force"], 1e-6)
        for a, b in zip(few["states"], many["states"], strict=True):
            self.assertGreater(a["met_force_N"], a["load_N"] - 1e-12)
            self.assertLess(b["distance_over_height"], a["distance_over_height"])  # more sweeps, nearer to equilibrium
            self.assertLess(b["residual_over_force"], a["residual_over_force"])
            self.assertLess(abs(b["depth_mm"] / b["equilibrium_depth_mm"] - 1), 0.005)
        for state in linear["states"]:
            self.assertEqual((state["distance_over_height"], state["depth_mm"]), (0, state["equilibrium_depth_mm"]))
        for state in quadratic["states"]:  # on a mesh of its own
            self.assertIsNone(state["distance_over_height"])
        self.assertLess(linear["states"][-1]["depth_mm"], quadratic["states"][-1]["depth_mm"])  # linear elements lock

    def test_a_store_knows_its_mode(self):
        with tempfile.TemporaryDirectory() as folder:
            store = os.path.join(folder, "s.db")
            process = subprocess.Popen(
                [LUMO, "campaign", "run", "--store", store, "--mode", "paper", "--evaluations", "1", "--threads", "1"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            try:
                while (
                    process.poll() is None
                    and (status := run("campaign", "status", "--store", store, "--json")).returncode != 0
                ):
                    time.sleep(0.1)
                self.assertEqual(strict(status.stdout)["mode"], "paper")
                self.assertIn("paper mode", self.good("campaign", "status", "--store", store).stdout)
            finally:
                process.send_signal(signal.SIGTERM)
                process.communicate(timeout=60)
            self.assertEqual(process.returncode, 130)
            other = run("campaign", "run", "--store", store, "--evaluations", "1")
            self.assertEqual((other.returncode, other.stdout), (5, ""))
            self.assertIn("mechanics", other.stderr)

    def test_little_memory_is_a_numerical_failure(self):  # OpenBLAS would ask for its work area for ever
        for command, megabytes in [("press", 250), ("press", 300), ("press", 350), ("trace", 500)]:
            limited = f"ulimit -v {1000 * megabytes}; exec '{LUMO}' {command} --finger plain --loads 1 --threads 2"
            done = subprocess.run(
                ["bash", "-c", limited], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=120
            )
            self.assertIn(done.returncode, (0, 4), (command, megabytes, done.stderr))

    def test_what_the_machine_fails_at_is_told_with_its_stage_and_left_to_another_run(self):
        with tempfile.TemporaryDirectory() as folder:
            store = os.path.join(folder, "campaign.db")
            limited = f"ulimit -v 250000; exec '{LUMO}' campaign run --evaluations 2 --threads 2 --store {store}"
            for runs in (1, 2, 3):  # more than 15 of them in all would have closed the store to every later run
                done = subprocess.run(
                    ["bash", "-c", limited], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, timeout=300
                )
                self.assertEqual(done.returncode, 4, done.stderr)
                self.assertIn("5 of 5 evaluations failed", done.stderr)
                rows = strict(self.good("campaign", "export", "--store", store, "--json").stdout)
                self.assertEqual(len(rows), 5 * runs)
            for row in rows:
                self.assertEqual(row["state"], "failed")
                self.assertRegex(row["why"], "^(start|mesh|press|light).*: (out of memory|no memory left .*)$")

    def test_trace_leaves_what_press_leaves(self):
        with tempfile.TemporaryDirectory() as folder:
            for command in ["press", "trace"]:
                self.good(command, "--loads", "1,2", "--out", os.path.join(folder, command))
            pressed, traced = (
                {p.name: p.read_bytes() for p in (pathlib.Path(folder) / command).iterdir()}
                for command in ["press", "trace"]
            )
        self.assertEqual(set(traced) - set(pressed), {"response.svg", "trace.csv"})
        self.assertEqual({name: traced.get(name) for name in pressed}, pressed)  # byte for byte
        columns = traced["trace.csv"].decode().splitlines()[0]
        self.assertTrue(columns.startswith(pressed["press.csv"].decode().splitlines()[0] + ",response_1"), columns)

    def test_pictures(self):
        camera = ["--pixels", "48,20", "--focal", "154", "--samples", "8", "--load", "5", "--exposure", "auto"]
        reports, files = [], []
        for threads in ["1", "2"]:
            with tempfile.TemporaryDirectory() as folder:
                done = self.good(
                    "render", *camera, "--json", "--radiance", "--out", folder, "--threads", threads
                )
                reports.append(without_times(strict(done.stdout)))
                files.append({p.name: p.read_bytes() for p in pathlib.Path(folder).iterdir()})
        self.assertEqual(reports[0], reports[1])
        self.assertEqual(files[0], files[1])
        self.assertEqual(
            sorted(files[0]), ["difference_5N.png", "pressed_5N.pfm", "pressed_5N.png", "unloaded.pfm", "unloaded.png"]
        )
        unloaded, pressed = reports[0]["pictures"]
        self.assertEqual([unloaded["load_N"], pressed["load_N"]], [0, 5])
        for name, picture in [("unloaded", unloaded), ("pressed_5N", pressed)]:
            head, pixels = files[0][name + ".pfm"].split(b"\n-1.0\n", 1)
            self.assertEqual(head, b"Pf\n48 20")
            values = struct.unpack("<960f", pixels)
            self.assertTrue(all(v >= 0 and math.isfinite(v) for v in values))
            self.assertAlmostEqual(
                sum(values) / 960 / picture["mean_radiance_per_m2_sr"], 1.0, delta=1e-5
            )
            self.assertEqual(struct.unpack(">II", files[0][name + ".png"][16:24]), (48, 20))
        self.assertAlmostEqual(
            pressed["mean_change_per_m2_sr"],
            pressed["mean_radiance_per_m2_sr"] - unloaded["mean_radiance_per_m2_sr"],
            delta=1e-6 * unloaded["mean_radiance_per_m2_sr"],
        )
        self.assertGreater(abs(pressed["mean_change_per_m2_sr"]), pressed["mean_change_per_m2_sr_err"])
        self.assertLessEqual(unloaded["saturated"], 0.02)  # lamps that are seen
        ledger = reports[0]["ledger"]
        self.assertAlmostEqual(ledger["emitted"], sum(v for k, v in ledger.items() if k != "emitted"), delta=1e-9)

    def test_trace_does_not_depend_on_threads(self):
        one, two = (
            without_times(strict(self.good("trace", "--json", "--loads", "1", "--threads", n).stdout))
            for n in ("1", "2")
        )
        self.assertEqual(one, two)
        self.assertEqual(len(one["unloaded_response"]), 11)
        self.assertEqual(len(one["states"][0]["response"]), 11)
        ledger = one["ledger"]
        self.assertAlmostEqual(ledger["emitted"], sum(v for k, v in ledger.items() if k != "emitted"), delta=1e-9)
        self.assertLessEqual(abs(ledger["lost"]), 1e-6)
        self.assertLess(abs(ledger["sampling"]), 0.02 * ledger["regions"])
        for response, error in zip(one["unloaded_response"], one["unloaded_response_err"], strict=True):
            self.assertTrue(0 < error < 0.05 * response, (response, error))
        # What rays do not know of a change is far less than what they do not know of the response, for both states
        # share them.
        self.assertEqual(len(one["states"][0]["response_change_err"]), 11)
        self.assertTrue(0 < sum(one["states"][0]["response_change_err"]) < 0.5 * sum(one["unloaded_response_err"]))

    def test_interrupt_is_clean(self):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            with self.subTest(number):
                self.interrupted(number)

    def test_a_terminal_sees_a_bar_with_the_time_left(self):
        ours, theirs = pty.openpty()
        process = subprocess.Popen(
            [LUMO, "trace", "--finger", "plain", "--loads", "1,2"], stdout=subprocess.PIPE, stderr=theirs
        )
        os.close(theirs)
        seen = b""
        try:
            while part := os.read(ours, 4096):
                seen += part
        except OSError:  # the other end is closed
            pass
        os.close(ours)
        process.communicate(timeout=60)
        self.assertEqual(process.returncode, 0)
        shown = seen.decode()
        self.assertRegex(shown, r"\r\x1b\[Ktrace █+░+ [12]/3, [\d.]+ m?s left")
        self.assertRegex(shown, r"\r\x1b\[Klumo: trace: done in [\d.]+ m?s\r\n")
        self.assertNotIn("lumo: trace ...", shown)  # that is for logs

    def test_termination_is_heard_at_any_moment(self):  # METIS has a handler of its own for it
        for moment in range(25):
            process = subprocess.Popen(
                [LUMO, "press", "--finger", "plain", "--loads", "1", "--threads", "1"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            time.sleep(0.1 + 0.04 * moment)
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=20)
            self.assertIn(process.returncode, (130, 0))  # 0: it had already ended
            self.assertTrue(process.returncode == 130 or moment > 10)

    def interrupted(self, number):
        with tempfile.TemporaryDirectory() as folder:
            out = os.path.join(folder, "out")
            process = subprocess.Popen(
                [LUMO, "trace", "--angle", "20", "--y", "5.5", "--out", out],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            time.sleep(1)
            process.send_signal(number)
            stdout, stderr = process.communicate(timeout=20)
            self.assertEqual(process.returncode, 130)
            self.assertEqual(stdout, "")
            self.assertIn("lumo: interrupted\n", stderr)
            self.assertEqual(os.listdir(folder), [])


class Long(unittest.TestCase):
    def test_evaluate(self):
        with tempfile.TemporaryDirectory() as folder:
            done = run("evaluate", "--json", "--out", folder, timeout=7200, finger="built")
            self.assertEqual(done.returncode, 0, done.stderr)
            report = strict(done.stdout)
            self.assertEqual(strict((pathlib.Path(folder) / "evaluation.json").read_text()), report)
        self.assertEqual(list(report), EVALUATION)
        self.assertEqual(len(report["scenarios"]), 28)
        self.assertEqual(len(report["unloaded_response"]), 11)
        for scenario in report["scenarios"]:
            self.assertEqual(list(scenario), SCENARIO)
            self.assertEqual(scenario["status"], "converged")
            self.assertEqual([s["load_N"] for s in scenario["states"]], [1, 2, 5, 10, 15])
            for state in scenario["states"]:
                self.assertEqual(len(state["response"]), 11)
                self.assertEqual(len(state["response_change_err"]), 11)
        self.assertLessEqual(abs(report["ledger"]["lost"]), 1e-6)
        qualities = [(s["q_form"] * s["q_stable"] * s["q_stiff"]) ** (1 / 3) for s in report["scenarios"]]
        self.assertAlmostEqual(min(qualities), report["J_contact"], places=6)

    def test_paper_mode_is_scored_as_held(self):
        arguments = ["evaluate", "--json", "--mode", "paper", "--size", "4", "--sweeps", "5"]
        done = run(*arguments, timeout=3600)
        self.assertEqual(done.returncode, 0, done.stderr)
        report = strict(done.stdout)
        self.assertEqual(list(report), EVALUATION)
        self.assertEqual(
            report["mechanics"],
            {
                **MECHANICS,
                "mode": "paper",
                "solver": "vbd",
                "element": "linear",
                "size_mm": 4,
                "sweeps": 5,
                "law": "newton",
                "friction": 0.5,
            },
        )
        self.assertEqual({s["status"] for s in report["scenarios"]}, {"held"})
        for scenario in report["scenarios"]:
            one, two, three, four = ((s["force_N"], s["depth_mm"]) for s in scenario["states"][:4])
            early, late = (two[0] - one[0]) / (two[1] - one[1]), (four[0] - three[0]) / (four[1] - three[1])
            self.assertAlmostEqual(scenario["q_stiff"], min(1, max(0, 1 - early / late)), places=9)
        qualities = [(s["q_form"] * s["q_stable"] * s["q_stiff"]) ** (1 / 3) for s in report["scenarios"]]
        self.assertAlmostEqual(min(qualities), report["J_contact"], places=6)
        self.assertGreater(report["J_obs"], 0)

    def test_curved_ensemble(self):
        done = run(
            "evaluate",
            "--json",
            "--ensemble",
            "curved",
            "--mode",
            "paper",
            "--size",
            "5",
            "--sweeps",
            "2",
            "--ray-error",
            "100",
            timeout=3600,
        )
        self.assertEqual(done.returncode, 0, done.stderr)
        report = strict(done.stdout)
        self.assertEqual(report["ensemble"], "curved")
        contacts = {(s["diameter_mm"], s["angle_deg"], s["y_mm"]) for s in report["scenarios"]}
        self.assertEqual(len(report["scenarios"]), 140)
        self.assertEqual(
            contacts,
            {
                (d, a, y)
                for d in (10, 15, 20, 30)
                for a in (-30, -15, 0, 15, 30)
                for y in (-22, -11, -5.5, 0, 5.5, 11, 22)
            },
        )

    def test_campaign_keeps_what_evaluate_gives(self):
        with tempfile.TemporaryDirectory() as folder:
            store, page = os.path.join(folder, "campaign.db"), os.path.join(folder, "report.html")
            done = run(
                "campaign", "run", "--store", store, "--evaluations", "1", "--ray-error", "5", "--json", timeout=7200
            )
            self.assertEqual(done.returncode, 0, done.stderr)
            status = strict(done.stdout)
            row = strict(run("campaign", "export", "--store", store, "--json").stdout)[0]
            self.assertEqual(run("campaign", "verify", "--store", store).returncode, 0)
            self.assertEqual(run("campaign", "report", "--store", store, "--out", page, timeout=1800).returncode, 0)
            self.assertGreater(os.path.getsize(page), 100000)
        theta = ",".join(str(v) for v in row["theta_mm"])
        alone = strict(
            run("evaluate", "--theta", theta, "--ray-error", "5", "--json", timeout=7200, finger="built").stdout
        )
        self.assertEqual(status["evaluated"], 1)
        for key in ["J_contact", "J_obs"]:
            self.assertEqual(row["record"][key], alone[key])
        self.assertEqual(row["record"]["scenarios"], alone["scenarios"])

    def test_study_goes_on_where_it_was_stopped(self):
        with tempfile.TemporaryDirectory() as folder:
            whole, parts = os.path.join(folder, "whole.db"), os.path.join(folder, "parts.db")
            first = run("study", "carrier", "--designs", "1", "--store", parts, "--json")
            self.assertEqual(first.returncode, 0, first.stderr)
            second = run("study", "carrier", "--designs", "2", "--store", parts, "--json", "--out", folder)
            self.assertEqual(second.returncode, 0, second.stderr)
            self.assertEqual(
                run("study", "carrier", "--designs", "2", "--store", whole, "--json").stdout, second.stdout
            )
            again = run(
                "study", "carrier", "--designs", "2", "--store", parts, "--json", timeout=60
            )  # nothing is left to do
            self.assertEqual(again.stdout, second.stdout)
            other = run("study", "void", "--designs", "2", "--store", parts)
            self.assertEqual((other.returncode, other.stdout), (5, ""))
            self.assertIn("belongs to another problem", other.stderr)
            table = (pathlib.Path(folder) / "study_carrier.csv").read_text().splitlines()
            for name in ["bonded_base", "unsupported_base"]:
                xml.etree.ElementTree.parse(pathlib.Path(folder) / f"study_carrier_{name}_J_contact.svg")
        self.assertEqual(len(table), 3)
        report = strict(second.stdout)
        self.assertEqual(report["designs"][:1], strict(first.stdout)["designs"])
        for design in report["designs"]:
            j = {v["variant"]: v["J_contact"] for v in design["record"]["variants"]}
            for twin in ["bonded_base", "unsupported_base"]:
                self.assertAlmostEqual(design[f"{twin} delta_J_contact"][0], j["design"] - j[twin], places=12)
            self.assertGreater(j["design"], j["unsupported_base"])  # the paper's finding, in every design


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    LONG = len(sys.argv) > 1 and sys.argv.pop(1) == "long"
    unittest.main(defaultTest="Long" if LONG else "Quick")
