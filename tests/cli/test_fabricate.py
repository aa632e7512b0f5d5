"""`lumo fabricate` from outside: files, JSON, exit codes, one line for every error. Standard library only.

usage: test_fabricate.py path/to/lumo
"""

import collections
import json
import math
import os
import pathlib
import random
import re
import struct
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree
import zipfile

from refusal import check_refusal

LUMO = ""
USAGE, INFEASIBLE, BAD_FILE = 2, 3, 5
CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
EXTREMES = [
    "2,5.5,4,2,0",
    "19,1,15,2,2",
    "19,1,4,14.5,7.5",
    "2,18,4,2,7.5",
    "10,8,4.5,4,7.5",
    "8,1,4,2,0.5",
    "19,1,15,14,2",
]


def run(*arguments, **options):
    return subprocess.run(
        [LUMO, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        env=dict(os.environ, LC_ALL="C"),
        **options,
    )


def fabricate(folder, *arguments, finger="plain"):
    done = run("fabricate", "--json", "--quiet", "--finger", finger, "--out", folder, *arguments)
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    return json.loads(done.stdout)


def read_stl(path):
    """Triangles of three corners each, in mm."""
    data = path.read_bytes()
    count = struct.unpack_from("<I", data, 80)[0]
    assert len(data) == 84 + 50 * count and not data.startswith(b"solid")
    return [tuple(struct.unpack_from("<3f", data, 96 + 50 * k + 12 * i) for i in range(3)) for k in range(count)]


def read_3mf(path):
    """Triangles of each object by its name, and what is to be printed: (name, where)."""
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        types, relations = (
            xml.etree.ElementTree.fromstring(package.read(name)) for name in ["[Content_Types].xml", "_rels/.rels"]
        )
        assert {"rels", "model"} == {e.get("Extension") for e in types}
        model = xml.etree.ElementTree.fromstring(package.read(relations[0].get("Target").lstrip("/")))
    assert model.get("unit") == "millimeter"
    objects, names = {}, {}
    for o in model.iter(CORE + "object"):
        points = [tuple(float(v.get(k)) for k in "xyz") for v in o.iter(CORE + "vertex")]
        objects[o.get("name")] = [
            tuple(points[int(t.get(k))] for k in ["v1", "v2", "v3"]) for t in o.iter(CORE + "triangle")
        ]
        names[o.get("id")] = o.get("name")
    items = [
        (names[i.get("objectid")], [float(v) for v in i.get("transform").split()]) for i in model.iter(CORE + "item")
    ]
    return objects, items


def volume(triangles):
    """Of a closed surface; fails where an edge has not exactly one partner."""
    edges = collections.Counter((t[i], t[(i + 1) % 3]) for t in triangles for i in range(3))
    assert all(n == 1 and edges[b, a] == 1 for (a, b), n in edges.items()), "not closed"
    return (
        sum(
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
            for a, b, c in triangles
        )
        / 6.0
    )


def box(triangles):
    return [(min(p[i] for t in triangles for p in t), max(p[i] for t in triangles for p in t)) for i in range(3)]


class Files(unittest.TestCase):
    def setUp(self):
        self.scratch = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.scratch.name)

    def tearDown(self):
        self.scratch.cleanup()

    def names(self, folder):
        return sorted(p.name for p in folder.iterdir())

    def test_files_and_report(self):
        out = self.folder / "new" / "out"
        report = fabricate(out, "--theta", "5,10,10,6,3", "--material", "Sol")
        self.assertEqual(
            self.names(out),
            sorted(
                [
                    "carrier.stl",
                    "mould_a.stl",
                    "mould_b.stl",
                    "core.stl",
                    "carrier.3mf",
                    "mould.3mf",
                    "casting_section.dxf",
                    "casting_section.svg",
                    "led_strip.dxf",
                    "led_strip.svg",
                    "core.dxf",
                    "core.svg",
                    "fabrication.json",
                ]
            ),
        )
        self.assertEqual(json.loads((out / "fabrication.json").read_text()), report)
        self.assertEqual((report["theta_mm"], report["material"]), ([5, 10, 10, 6, 3], "Sol"))
        silicone = report["silicone"]
        self.assertAlmostEqual(silicone["pad_volume_mm3"], 60 * (29.5 * 5 + math.pi / 4 * 29.5 * 10 - 16 * 6), 6)
        self.assertAlmostEqual(silicone["pad_mass_g"], silicone["pad_volume_mm3"] * 990e-6, 9)
        self.assertAlmostEqual(
            silicone["cast_volume_mm3"], sum(silicone[k + "_volume_mm3"] for k in ["pad", "fits", "openings"]), 6
        )
        self.assertAlmostEqual(silicone["part_a_g"] + silicone["part_b_g"], 1.25 * silicone["cast_mass_g"], 9)
        for part in report["parts"]:
            self.assertAlmostEqual(part["mass_g"], part["volume_mm3"] * 1240e-6, 9)
        self.assertGreater(report["least_draft_deg"], 0)
        self.assertEqual(report["notes"], [])
        # Without voids there is no core; an older run's stays, like any file that is not written anew.
        fabricate(self.folder / "flat", "--theta", "6,6,8,5,0")
        self.assertFalse([n for n in self.names(self.folder / "flat") if "core" in n])

    def check_solids(self, theta, finger="plain"):
        with self.subTest(finger + " " + theta):
            out = self.folder / finger / theta
            report = fabricate(out, "--theta", theta, finger=finger)
            solids = {p["name"]: p for p in report["parts"]}
            printed, items = {}, []
            for package in ["carrier", "mould"]:
                found, placed = read_3mf(out / f"{package}.3mf")
                printed.update(found)
                items += placed
                # Copies stand beside each other on the bed.
                boxes = sorted((box(found[name])[0][0] + t[9], box(found[name])[0][1] + t[9]) for name, t in placed)
                self.assertTrue(all(a[1] < b[0] for a, b in zip(boxes, boxes[1:])), boxes)
                self.assertTrue(all(t[:9] == [1, 0, 0, 0, 1, 0, 0, 0, 1] for _, t in placed))
            self.assertEqual(set(printed), set(solids))
            for name, part in solids.items():
                triangles = read_stl(out / part["file"])
                for found in [triangles, printed[name]]:
                    self.assertAlmostEqual(volume(found) / part["volume_mm3"], 1, 5)
                    for (low, high), edge in zip(box(found), part["box_mm"]):
                        self.assertAlmostEqual(low, 0, 4)
                        self.assertAlmostEqual(high, edge, 4)
                self.assertEqual(sum(n == name for n, _ in items), part["copies"])

    def test_solids_over_the_space(self):
        chance, drawn = random.Random(3), 0
        for theta in EXTREMES:
            self.check_solids(theta)
        while drawn < 8:
            theta = ",".join(
                str(chance.randint(2 * low, 2 * high) / 2) for low, high in [(2, 18), (1, 18), (4, 15), (2, 10), (0, 7)]
            )
            if run("section", "--finger", "plain", "--theta", theta).returncode == 0:
                drawn += 1
                self.check_solids(theta)
        for theta in ["5,9,7.6,6,2", "8,1.5,9,4,5", "14.5,4,5,12.5,5", "13,7,7.5,14.5,0"]:
            self.check_solids(theta, "built")

    def test_the_finger_as_built(self):
        out = self.folder / "out"
        report = fabricate(out, finger="built")  # its own baseline, off the lattice
        self.assertEqual(report["theta_mm"], [5, 9, 7.6, 6, 2])
        self.assertEqual({p["name"] for p in report["parts"]}, {"carrier", "led_bar", "mould_a", "mould_b", "core"})
        self.assertAlmostEqual(report["silicone"]["pad_volume_mm3"], 23495.5, delta=5)

    def test_same_bits(self):
        for folder in ["a", "b"]:
            fabricate(self.folder / folder, "--theta", "5,10,10,6,3")
        for name in self.names(self.folder / "a"):
            self.assertEqual((self.folder / "a" / name).read_bytes(), (self.folder / "b" / name).read_bytes(), name)

    def test_options(self):
        report = fabricate(
            self.folder / "out",
            "--clearance",
            "0.1",
            "--plate",
            "5",
            "--wall",
            "9",
            "--strip-width",
            "3",
            "--strip-height",
            "1",
            "--gate",
            "3",
            "--vent",
            "1",
        )
        self.assertEqual(
            report["options_mm"],
            {"clearance": 0.1, "plate": 5, "wall": 9, "strip_width": 3, "strip_height": 1, "gate": 3, "vent": 1},
        )
        # A file says the same, and the report's configuration is such a file.
        file = self.folder / "casting.json"
        file.write_text(json.dumps(report["configuration"]))
        again = run("fabricate", "--config", file, "--quiet", "--out", self.folder / "again", "--json")
        self.assertEqual(json.loads(again.stdout), report)
        self.assertEqual(
            (self.folder / "out/mould_a.stl").read_bytes(), (self.folder / "again/mould_a.stl").read_bytes()
        )
        parts = {p["name"]: p for p in report["parts"]}
        for name, wanted in [("carrier", [35.5, 74, 10]), ("mould_a", [29.5 + 18, 12 + 9 + 3, 60 + 7.1 + 5.9 + 0])]:
            for edge, value in zip(parts[name]["box_mm"], wanted):
                self.assertAlmostEqual(edge, value, 9)
        self.assertIn(
            "the cores are 0.5 mm thick", fabricate(self.folder / "thin", "--theta", "8,1,4,2,0.5")["notes"][0]
        )

    def test_drawings_are_in_mm(self):
        fabricate(self.folder, "--theta", "5,10,10,6,3")
        for name, size in [("led_strip", (52, 2)), ("core", (82, 9)), ("casting_section", (45.5, 27))]:
            drawing = xml.etree.ElementTree.parse(self.folder / f"{name}.svg").getroot()
            width, height = (float(drawing.get(k).removesuffix("mm")) for k in ["width", "height"])
            self.assertEqual([float(v) for v in drawing.get("viewBox").split()], [0, 0, width, height])
            points = [
                tuple(map(float, p.split()))
                for path in drawing.iter("{http://www.w3.org/2000/svg}path")
                for p in re.split("[MLZ]", path.get("d"))
                if p
            ]
            self.assertTrue(all(0 <= x <= width and 0 <= y <= height for x, y in points))
            outlines = [
                p
                for group in drawing.iter("{http://www.w3.org/2000/svg}g")
                if group.get("id") != "NOTES"
                for path in group
                for p in re.split("[MLZ]", path.get("d") or "")
                if p
            ]
            span = [max(v) - min(v) for v in zip(*(tuple(map(float, p.split())) for p in outlines))]
            for got, wanted in zip(span, size):
                self.assertAlmostEqual(got, wanted, 5, name)

    def test_text(self):
        done = run("fabricate", "--finger", "plain", "--out", self.folder, "--theta", "5,10,10,6,3")
        self.assertEqual(done.returncode, 0)
        for words in ["mould_a", "core", "mm³", "g of A"]:
            self.assertIn(words, done.stdout)
        self.assertEqual(done.stderr.count("wrote "), 13)


class Refusals(unittest.TestCase):
    def refused(self, code, words, *arguments):
        with self.subTest(" ".join(arguments)), tempfile.TemporaryDirectory() as folder:
            done = run("fabricate", "--finger", "plain", *arguments, cwd=folder)
            check_refusal(self, done, code, words)
            self.assertEqual(os.listdir(folder), [])

    def test_refusals(self):
        self.refused(USAGE, ["--out is missing", "lumo fabricate --help"])
        self.refused(USAGE, ["--out is missing"], "--json")
        self.refused(USAGE, ["unknown option '--threads'"], "--out", "o", "--threads", "2")
        self.refused(USAGE, ["five numbers"], "--out", "o", "--theta", "6")
        self.refused(USAGE, ["DS or Sol"], "--out", "o", "--material", "PDMS")
        for option, bad, limits in [
            ("--clearance", ["0", "0.5", "-1"], "[0.05, 0.4] mm"),
            ("--plate", ["2", "21"], "[3, 20] mm"),
            ("--wall", ["6", "31"], "[7, 30] mm"),
            ("--strip-width", ["0.5", "11"], "[0.8, 10] mm"),
            ("--strip-height", ["0.1", "2"], "[0.2, 1.5] mm"),
            ("--gate", ["1", "5"], "[2, 4] mm"),
            ("--vent", ["0.5", "3"], "[0.8, 2] mm"),
        ]:
            for text in bad:
                self.refused(USAGE, [f"{option} is '{text}'", limits], "--out", "o", option, text)
            for text in ["nan", "wide", ""]:
                self.refused(USAGE, [option], "--out", "o", option, text)
        for plate in [["--plate", "4"], ["--plate", "5"], ["--set", "casting.plate_mm=5"]]:  # of the finger as built
            done = run("fabricate", *plate, "--out", "o")
            check_refusal(self, done, USAGE, ["casting.plate_mm", "flat carrier", "finger.carrier_height_mm"])
        self.refused(USAGE, ["casting.wall_mm", "[7, 30] mm"], "--out", "o", "--set", "casting.wall_mm=6")
        self.refused(USAGE, ["LED strip width is 7 mm, must be at most 6.4 mm"], "--out", "o", "--strip-width", "7")
        self.refused(INFEASIBLE, ["t_min"], "--out", "o", "--theta", "2,6,8,5,0")
        self.refused(BAD_FILE, ["not a directory"], "--out", "/dev/null/x")

    def test_nothing_half_written(self):
        with tempfile.TemporaryDirectory() as folder:
            taken = pathlib.Path(folder) / "mould_b.stl"
            taken.mkdir()
            done = run("fabricate", "--finger", "plain", "--quiet", "--out", folder)
            self.assertEqual((done.returncode, done.stderr.count("\n")), (BAD_FILE, 1), done.stderr)
            self.assertIn("is a directory", done.stderr)
            self.assertEqual(os.listdir(folder), ["mould_b.stl"])


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
