"""Configurations: layers, files, what is refused, and that a dump read back is the same computation.

usage: test_configuration.py path/to/lumo path/to/docs
"""

import copy
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import unittest

from refusal import check_refusal

LUMO, DOCS = "", pathlib.Path()
USAGE, INFEASIBLE, BAD_FILE = 2, 3, 5


def run(*arguments, **options):
    return subprocess.run([LUMO, *arguments], capture_output=True, text=True, timeout=300, **options)


def dump(*arguments):
    done = run("config", "--json", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def values(whole):
    return {key: value for key, value in whole.items() if key != "from"}


def flat(tree, above=""):
    """Path → value of what is no object."""
    for key, value in tree.items():
        path = above + key
        if isinstance(value, dict):
            yield from flat(value, path + ".")
        else:
            yield path, value


class Configurations(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = pathlib.Path(folder.name) / "c.json"

    def write(self, content):
        self.file.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return str(self.file)

    def refused(self, code, words, *arguments):
        with self.subTest(" ".join(arguments)):
            check_refusal(self, run("config", *arguments), code, words)

    def test_time_limit(self):
        def limit(*arguments):
            done = run(*arguments, "--dump-config")
            self.assertEqual(done.returncode, 0, done.stderr)
            return json.loads(done.stdout)["limits"]["scenario_time_s"]

        for command in ["press", "trace", "evaluate"]:
            self.assertIsNone(limit(command))
        campaign = ["campaign", "run", "--store", "none.db"]
        for given, wanted in [([], 3600), (["--time-limit", "5"], 5), (["--set", "limits.scenario_time_s=null"], None)]:
            self.assertEqual(limit(*campaign, *given), wanted)
        # Whatever is chosen after it.
        self.assertEqual(limit("press", "--time-limit", "5", "--mode", "paper"), 5)

    def test_layers(self):
        file = self.write({"assume": ["built"], "finger": {"width_mm": 31}, "contact": {"y_mm": 3}})
        whole = dump("--config", file, "--assume", "bonded_stem", "--set", "contact.y_mm=4", "--material", "Sol")
        self.assertEqual(whole["finger"]["width_mm"], 31)
        self.assertEqual(whole["finger"]["stem"], "bonded")
        self.assertEqual(whole["contact"]["y_mm"], 4)
        self.assertEqual(whole["silicone"]["refractive_index"], 1.41)
        self.assertEqual(whole["theta_mm"], [5, 9, 7.6, 6, 2])
        origin = whole["from"]
        self.assertEqual(origin["finger.width_mm"], f"file {file}")
        self.assertEqual(origin["finger.stem"], "--assume bonded_stem")
        self.assertEqual(origin["contact.y_mm"], "--set contact.y_mm")
        self.assertEqual(origin["silicone.refractive_index"], "--material")
        self.assertEqual(origin["contact.diameter_mm"], "default (paper)")
        self.assertEqual(set(origin), {path for path, _ in flat(values(whole))})

    def test_design_stays(self):
        self.assertEqual(dump("--finger", "built")["theta_mm"], [5, 9, 7.6, 6, 2])
        self.assertEqual(dump("--finger", "plain")["theta_mm"], [6, 6, 8, 5, 0])
        self.assertEqual(dump("--finger", "built", "--theta", "8,1.5,9,4,5")["theta_mm"], [8, 1.5, 9, 4, 5])
        file = self.write({"theta_mm": [8, 1.5, 9, 4, 5]})
        self.assertEqual(dump("--config", file, "--finger", "built")["theta_mm"], [8, 1.5, 9, 4, 5])

    def test_authors(self):
        def chosen(*options):
            w = dump(*options)
            return [
                w["leds"]["film_closes_mm"],
                w["readout"]["by_direction"],
                w["readout"]["in_space"],
                w["mechanics"]["record_margin_mm"],
                w["mechanics"]["hold_s"],
            ]

        self.assertEqual(chosen(), [None, False, False, 0, 1])
        authors = [0, True, True, 0.1, 0]
        self.assertEqual(chosen("--assume", "authors"), authors)
        with_mode = ["--assume", "authors", "--set", "mechanics.mode=paper"]
        self.assertEqual(chosen(*with_mode), authors)
        self.assertEqual(dump(*with_mode)["mechanics"]["solver"], "vbd")
        singles = ["film_closes_on_touch", "seen_by_direction", "bins_in_space", "contact_by_records", "first_crossing"]
        self.assertEqual(chosen(*[word for name in singles for word in ("--assume", name)]), authors)

    def test_dump_read_back(self):
        chosen = random.Random(1)
        for k in range(40):
            sets = []
            for path, low, high in [
                ("contact.diameter_mm", 5, 30),
                ("leds.recess_depth_mm", 0, 1),
                ("mesh.finest_edge_mm", 0.1, 1),
                ("contact.angle_deg", -30, 30),
                ("silicone.scattering_per_m", 0, 100),
            ]:
                sets += ["--set", f"{path}={chosen.uniform(low, high)!r}"]
            sets += ["--set", "ensemble.angles_deg=" + ",".join(repr(chosen.uniform(-60, 60)) for _ in range(3))]
            first = dump(*sets, *chosen.choice([["--finger", "built"], ["--assume", "wetted_white"], []]))
            second = dump("--config", self.write(first))
            self.assertEqual(values(first), values(second))

    def test_same_bits(self):
        options = ["--diameter", "12.345678901234567", "--angle", "7.1", "--loads", "1", "--set", "mesh.seam_edge_mm=0.7"]
        asked = ["--finger", "plain", "--size", "5", *options]
        typed = run("press", "--json", "--quiet", *asked)
        self.assertEqual(typed.returncode, 0, typed.stderr)
        kept = run("press", "--dump-config", *asked)
        self.assertEqual(kept.returncode, 0, kept.stderr)
        read = run("press", "--json", "--quiet", "--config", self.write(kept.stdout))
        self.assertEqual(read.returncode, 0, read.stderr)
        one, other = json.loads(typed.stdout), json.loads(read.stdout)
        one.pop("seconds"), other.pop("seconds")
        self.assertEqual(one, other)
        self.assertEqual(one["configuration"], values(json.loads(kept.stdout)))

    def test_refused_options(self):
        self.refused(USAGE, ["finger.widht_mm", "the nearest is 'finger.width_mm'"], "--set", "finger.widht_mm=3")
        self.refused(USAGE, ["must be PATH=VALUE"], "--set", "finger.width_mm")
        self.refused(USAGE, ["--set finger.width_mm is '0.5'", "[1, 200] mm"], "--set", "finger.width_mm=0.5")
        self.refused(USAGE, ["must be true or false"], "--set", "finger.held_ends=yes")
        self.refused(USAGE, ["bonded or free"], "--set", "finger.stem=glued")
        self.refused(USAGE, ["'bonded_stm'", "the nearest is 'bonded_stem'"], "--assume", "bonded_stm")
        self.refused(USAGE, ["built or plain"], "--finger", "square")
        self.refused(USAGE, ["silicone 'Eco'", "density_kg_per_m3 is missing"], "--set", "silicone.name=Eco")
        self.refused(USAGE, ["power of two"], "--set", "light.exit_rays=100000")
        self.refused(USAGE, ["twice"], "--set", "ensemble.places_mm=1,2,1")
        self.refused(USAGE, ["--material takes back --set silicone.shear_modulus_Pa"], "--material", "Sol", "--set",
                     "silicone.shear_modulus_Pa=50000")
        self.refused(USAGE, ["--theta takes back --set theta_mm"], "--theta", "5,9,7,6,2", "--set", "theta_mm=3,8,7,8,5")
        own = ["--set", "ensemble.diameters_mm=10", "--ensemble", "flat", "--dump-config"]
        check_refusal(self, run("evaluate", *own), USAGE, ["--ensemble takes back --set ensemble.diameters_mm"])
        self.refused(USAGE, ["be null: the tool"], "--set", "finger.touched_reflectance=0.5")
        self.refused(INFEASIBLE, ["t_min"], "--theta", "6,6,8,12,0")
        self.refused(BAD_FILE, ["nowhere.json", "cannot be read"], "--config", "nowhere.json")

    def test_refused_files(self):
        for words, content in [
            (["unknown key 'fingr'", "nearest is 'finger'"], {"fingr": {}}),
            (["unknown key 'finger.width'", "nearest is 'finger.width_mm'"], {"finger": {"width": 30}}),
            (["finger is 3", "object"], {"finger": 3}),
            (["finger.width_mm is '30'", "be a number [mm]"], {"finger": {"width_mm": "30"}}),
            (["finger.width_mm is null"], {"finger": {"width_mm": None}}),
            (["leds.count is 5.5", "whole number from 0 to 1000"], {"leds": {"count": 5.5}}),
            (["theta_mm", "4 fields", "five numbers"], {"theta_mm": [1, 2, 3, 4]}),
            (["contact.loads_N", "follows 2 N"], {"contact": {"loads_N": [1, 2, 2]}}),
            (["assume", "list of names"], {"assume": "plain"}),
            (["unknown assumption 'plian'", "'plain'"], {"assume": ["plian"]}),
            (["twice"], '{"leds": {"count": 5, "count": 6}}'),
            (["not JSON"], '{"leds": {"count": 5}'),
            (["not finite"], '{"leds": {"power_W": 1e999}}'),
            (["must be an object"], "[]"),
            (["not JSON"], ""),
            (["deep"], "[" * 100 + "]" * 100),
            (["is missing", "silicone"], {"silicone": {"name": "Eco", "absorption_per_m": 3}}),
            (["must be text"], {"from": {"theta_mm": 3}}),
            (["ensemble.name is 'flat'", "must be own"], {"ensemble": {"name": "flat", "places_mm": [0, 5.5]}}),
            (["contradicts mode paper"], {"mechanics": {"mode": "paper", "element": "quadratic"}}),
        ]:
            self.refused(BAD_FILE, ["configuration '" + str(self.file), *words], "--config", self.write(content))

    def test_own_silicone(self):
        card = dict(values(dump())["silicone"], name="Eco", shear_modulus_Pa=30000.0)
        whole = dump("--config", self.write({"silicone": card}))
        self.assertEqual(whole["silicone"], card)

    def test_mutated_files(self):
        """Each of a thousand is refused in one line, or says what the dump then says."""
        chosen = random.Random(33)
        whole = values(dump("--finger", "built", "--set", "finger.touched=white"))
        text = json.dumps(whole, indent=1)
        read = 0
        for k in range(1000):
            file = self.write(mutated(chosen, whole, text))
            done = run("config", "--json", "--config", file)
            with self.subTest(k=k, file=self.file.read_text(encoding="utf-8")[:300]):
                if done.returncode == 0:
                    read += 1
                    dumped = dict(flat(values(json.loads(done.stdout))))
                    kept = json.loads(self.file.read_text(encoding="utf-8"))
                    kept.pop("assume", None)
                    for path, value in flat(kept):
                        self.assertEqual(dumped[path], value, path)
                else:
                    self.assertIn(done.returncode, [USAGE, INFEASIBLE, BAD_FILE])
                    check_refusal(self, done, done.returncode, [])
        self.assertGreater(read, 20)
        self.assertLess(read, 500)

    def test_published(self):
        schema = run("config", "--schema").stdout
        self.assertEqual(schema, (DOCS / "configuration.schema.json").read_text(encoding="utf-8"))
        page = (DOCS / "pages" / "configuration.md").read_text(encoding="utf-8")
        for table in run("config", "--markdown").stdout.split("\n\n"):
            self.assertIn(table.strip(), page)
        known = {path for path, _ in flat(values(dump()))}
        described = set()
        for key, part in json.loads(schema)["properties"].items():
            described |= {f"{key}.{name}" for name in part["properties"]} if "properties" in part else {key}
        self.assertEqual(described - {"assume", "from", "$schema"}, known)


def mutated(chosen, whole, text):
    kind = chosen.randrange(6)
    if kind == 0:  # bytes
        at = chosen.randrange(len(text))
        return text[:at] + chosen.choice('{}[]",:0e-x\n') + text[at + chosen.randrange(2) :]
    if kind == 1:
        return text[: chosen.randrange(len(text))]
    tree = copy.deepcopy(whole)
    group = chosen.choice([key for key, value in tree.items() if isinstance(value, dict)])
    key = chosen.choice(list(tree[group]))
    if kind == 2:  # another name
        at = chosen.randrange(len(key))
        tree[group][key[:at] + chosen.choice("abx_") + key[at + 1 :]] = tree[group].pop(key)
    elif kind == 3:  # another kind of value
        tree[group][key] = chosen.choice([None, True, "x", -1, 1e300, 0.1234, [], {}, [1], 10**30])
    elif kind == 4:  # another place
        tree[chosen.choice(list(tree))] = tree[group].pop(key)
    else:  # another number
        if isinstance(tree[group][key], (int, float)) and not isinstance(tree[group][key], bool):
            tree[group][key] = tree[group][key] * chosen.choice([-1, 0, 0.5, 1.001, 2, 1e6])
    return json.dumps(tree)


if __name__ == "__main__":
    LUMO, DOCS = sys.argv[1], pathlib.Path(sys.argv[2])
    unittest.main(argv=sys.argv[:1])
