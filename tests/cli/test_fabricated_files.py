"""What other people's programs find in the files of `lumo fabricate`: trimesh and manifold3d that each part is a solid,
that the closed mould's cavity is the pad, and that it opens; ezdxf that the drawings are sound. Nothing here knows
lumo's layout: the mould is put together from what the report says, and the pad is its formula.

usage: test_fabricated_files.py path/to/lumo          (with the packages of tests/fabrication/requirements.txt; see
       tests/run)
"""

import json
import math
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import ezdxf
import ezdxf.bbox
import manifold3d
import numpy
import trimesh

LUMO = ""
DESIGNS = [
    "6,6,8,5,0",
    "5,10,10,6,3",
    "19,1,4,14.5,7.5",
    "10,8,4.5,4,7.5",
    "2,18,4,2,0.5",
    "19,1,15,14,2",
    "2,5.5,4,2,0",
]
# Of the default options, in mm.
PLATE, RIM, MOULD_END = 4.0, 3.0, 42.0


def solid(mesh):
    """As manifold3d takes it; it refuses what is no manifold."""
    m = manifold3d.Manifold(
        manifold3d.Mesh(numpy.asarray(mesh.vertices, numpy.float32), numpy.asarray(mesh.faces, numpy.uint32))
    )
    assert m.status() == manifold3d.Error.NoError and not m.is_empty(), m.status()
    return m


def box(low, high):
    return manifold3d.Manifold.cube([b - a for a, b in zip(low, high)]).translate(list(low))


def placed(mesh, turn, corner):
    """A printed part back in its place: turned, with the low corner of its box at `corner`."""
    moved = mesh.copy()
    moved.apply_transform(
        numpy.block([[numpy.array(turn, float), numpy.zeros((3, 1))], [numpy.zeros((1, 3)), numpy.ones((1, 1))]])
    )
    moved.apply_translation(numpy.array(corner) - moved.bounds[0])
    return solid(moved)


class Design:
    def __init__(self, theta):
        self.scratch = tempfile.TemporaryDirectory()
        self.folder = pathlib.Path(self.scratch.name)
        done = subprocess.run(
            [LUMO, "fabricate", "--finger", "plain", "--json", "--quiet", "--theta", theta, "--out", self.folder],
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
        self.report = json.loads(done.stdout)
        self.theta = self.report["theta_mm"]
        self.mesh = {p["name"]: trimesh.load_mesh(self.folder / p["file"]) for p in self.report["parts"]}

    def assembled(self):
        """Carrier, both mould halves and the cores in the finger's frame."""
        h_fp, h_ep, w_s, h_s, w_v = self.theta
        half = self.mesh["mould_a"].extents[0] / 2
        parts = {
            "carrier": placed(
                self.mesh["carrier"],
                numpy.eye(3),
                [-self.mesh["carrier"].extents[0] / 2, -self.mesh["carrier"].extents[1] / 2, -PLATE],
            ),
            "mould_a": placed(self.mesh["mould_a"], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], [-half, -30, -RIM]),
            "mould_b": placed(self.mesh["mould_b"], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], [-half, -MOULD_END, -RIM]),
        }
        if w_v > 0:
            for name, x in [("core_right", w_s / 2), ("core_left", -w_s / 2 - w_v)]:
                parts[name] = placed(self.mesh["core"], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], [x, -30, -RIM])
        return parts


def for_each_design(check):
    def test(self):
        for d in self.designs:
            with self.subTest(theta=d.theta):
                check(self, d)

    return test


class Parts(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.designs = [Design(theta) for theta in DESIGNS]

    @classmethod
    def tearDownClass(cls):
        for design in cls.designs:
            design.scratch.cleanup()

    @for_each_design
    def test_every_part_is_a_solid(self, d):
        for p in d.report["parts"]:
            mesh = d.mesh[p["name"]]
            self.assertTrue(mesh.is_watertight and mesh.is_winding_consistent and mesh.is_volume, p["name"])
            self.assertAlmostEqual(mesh.volume / p["volume_mm3"], 1, 5)
            self.assertAlmostEqual(solid(mesh).volume() / p["volume_mm3"], 1, 5)
            self.assertEqual(len(solid(mesh).decompose()), 1)
            self.assertTrue(numpy.allclose(mesh.bounds, [[0, 0, 0], p["box_mm"]], atol=1e-4))

    @for_each_design
    def test_3mf_opens_with_all_parts_apart(self, d):
        copies = {p["name"]: p["copies"] for p in d.report["parts"]}
        for package, names in [("carrier", ["carrier"]), ("mould", [n for n in copies if n != "carrier"])]:
            scene = trimesh.load_scene(d.folder / f"{package}.3mf")
            self.assertEqual(scene.units, "millimeter")
            self.assertEqual(set(scene.geometry), set(names))
            self.assertEqual(len(scene.graph.nodes_geometry), sum(copies[n] for n in names))
            self.assertTrue(all(g.is_watertight for g in scene.geometry.values()))
            meshes = scene.dump()
            whole = manifold3d.Manifold.batch_boolean([solid(m) for m in meshes], manifold3d.OpType.Add)
            self.assertAlmostEqual(whole.volume() / sum(m.volume for m in meshes), 1, 5)

    @for_each_design
    def test_the_cavity_is_the_pad(self, d):
        h_fp, h_ep, w_s, h_s, w_v = d.theta
        parts = manifold3d.Manifold.batch_boolean(list(d.assembled().values()), manifold3d.OpType.Add)
        cavity = box([-14.75, -30, 0], [14.75, 30, h_fp + h_ep]) - parts
        pad = 60 * (29.5 * h_fp + math.pi / 4 * 29.5 * h_ep - (w_s + 2 * w_v) * h_s)
        self.assertAlmostEqual(d.report["silicone"]["pad_volume_mm3"], pad, 6)
        # The room of the LED strip (2.4 × 52.4 × 0.9 mm), the duct below it (2 × 3 mm) and 0.2 mm of play at the stem's
        # ends are open, too.
        room = 2.4 * 52.4 * 0.9 + 6 * (h_s - 0.9) + w_s * h_s * 0.2
        self.assertAlmostEqual((cavity.volume() - room) / pad, 1, 3)
        # The chords of the curve are inside of it: the cavity is smaller by their segments, and by nothing else.
        self.assertLess(cavity.volume() - room, pad + 0.5)
        if w_v > 0:
            self.assertLess((box([w_s / 2, -30, 0], [w_s / 2 + w_v, 30, h_s]) ^ cavity).volume(), 0.01)  # the void
        silicone = box([w_s / 2 + w_v + 0.01, -29.99, 0.01], [14.74, 29.99, min(h_s, h_fp)])
        self.assertAlmostEqual((silicone ^ cavity).volume() / silicone.volume(), 1, 5)

    @for_each_design
    def test_parts_do_not_overlap(self, d):
        parts = list(d.assembled().items())
        for k, (name, part) in enumerate(parts):
            for other, second in parts[:k]:
                self.assertLess((part ^ second).volume(), 0.05, (name, other))

    @for_each_design
    def test_it_opens(self, d):
        parts = d.assembled()
        h_fp, h_ep, w_s, h_s, w_v = d.theta
        inside = box([-14.75, -30, 0], [14.75, 30, h_fp + h_ep])
        pad = inside - manifold3d.Manifold.batch_boolean(list(parts.values()), manifold3d.OpType.Add)
        cores = [p for n, p in parts.items() if n.startswith("core")]
        stays = manifold3d.Manifold.batch_boolean([pad, parts["carrier"], parts["mould_b"]], manifold3d.OpType.Add)
        way = numpy.array(d.report["opening_direction"])
        self.assertAlmostEqual(numpy.linalg.norm(way), 1, 9)
        for step in [0.05, 0.2, 1, 3, 10, 40]:
            for core in cores:  # first, along the finger
                moved = core.translate([0, step, 0])
                self.assertLess(
                    sum((moved ^ p).volume() for p in [pad, parts["carrier"], parts["mould_a"], parts["mould_b"]]), 0.05
                )
            a = parts["mould_a"].translate(list(step * way))
            self.assertLess((a ^ stays).volume(), 0.05, step)
            b = parts["mould_b"].translate(list(-step * way))
            self.assertLess((b ^ (pad + parts["carrier"])).volume(), 0.05, step)
            # The same straight across rubs at most, the wrong way it would tear.
            self.assertGreater((parts["mould_a"].translate(list(-step * way)) ^ stays).volume(), 0.5)

    @for_each_design
    def test_drawings(self, d):
        h_fp, h_ep, w_s, h_s, w_v = d.theta
        for name, size in [("casting_section", (45.5, h_fp + h_ep + 8 + PLATE)), ("led_strip", (52, 2))] + (
            [("core", (82, h_s + 3))] if w_v > 0 else []
        ):
            drawing = ezdxf.readfile(d.folder / f"{name}.dxf")
            self.assertEqual(drawing.dxfversion, "AC1009")
            audit = drawing.audit()
            self.assertEqual((audit.errors, audit.fixes), ([], []))
            shapes = [e for e in drawing.modelspace().query("POLYLINE") if e.dxf.layer != "NOTES"]
            extent = ezdxf.bbox.extents(shapes)
            self.assertTrue(numpy.allclose([extent.size.x, extent.size.y], size, atol=1e-5), (name, extent.size))
            self.assertEqual(
                {e.dxf.layer for e in drawing.modelspace()} - {layer.dxf.name for layer in drawing.layers}, set()
            )
            if name == "led_strip":
                leds = sorted(sum(v.dxf.location.x for v in e.vertices) / 4 for e in shapes if e.dxf.layer == "LEDS")
                self.assertTrue(numpy.allclose(leds, [-22, -11, 0, 11, 22], atol=1e-6))


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
