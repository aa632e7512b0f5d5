"""`lumo optimize` from outside: the protocol, its refusals, and transcripts that survive any end.

usage: test_program.py path/to/lumo
"""

import copy
import itertools
import json
import math
import os
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time
import unittest

LUMO = ""
USAGE, BAD_FILE = 2, 5
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
    "source": "paper",
}


def measure(x):
    a, b, t = x[0] / 20, x[1] / 20, x[2]
    return [1 - (a - 0.3) ** 2 - (b - 0.4) ** 2 - 0.1 * t * t, (a - 0.7) ** 2 + (b - 0.1) ** 2 + 0.1 * (t - 0.5) ** 2]


class Session:
    """The program with a space file of its own."""

    def __init__(self, folder, space=SPACE, transcript=None, more=()):
        path = pathlib.Path(folder) / "space.json"
        path.write_text(json.dumps(space))
        words = [LUMO, "optimize", "--space", str(path)] + (["--transcript", str(transcript)] if transcript else [])
        words += more
        self.process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def read(self):
        line = self.process.stdout.readline()
        return json.loads(line) if line else None

    def say(self, message):
        self.process.stdin.write((message if isinstance(message, str) else json.dumps(message)) + "\n")
        self.process.stdin.flush()

    def answer(self, ask):
        self.say({"tell": {"id": ask["id"], "y": measure(ask["x"])}})

    def end(self):
        self.process.stdin.close()
        self.process.stdin = None
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err

    def finish(self):
        """Answers all; returns what was asked and the last line."""
        asks = []
        while True:
            message = self.read()
            if message is None or "ask" not in message:
                return asks, message
            asks.append(message["ask"])
            self.answer(message["ask"])


class Protocol(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.transcript = pathlib.Path(self.folder.name) / "run.jsonl"

    def session(self, space=SPACE, keep=True, more=()):
        session = Session(self.folder.name, space, self.transcript if keep else None, more)
        self.addCleanup(
            lambda: (
                session.process.kill(),
                session.process.wait(),
                [f.close() for f in (session.process.stdin, session.process.stdout, session.process.stderr) if f],
            )
        )
        return session

    def whole_run(self, space=SPACE):
        session = self.session(space, keep=False)
        asks, last = session.finish()
        self.assertEqual(session.end(), (0, "", ""))
        return asks, last

    def test_a_whole_run(self):
        for source in ["paper", "default"]:
            asks, last = self.whole_run(dict(SPACE, source=source))
            self.assertEqual([a["id"] for a in asks], list(range(14)))
            self.assertEqual([a["x"] for a in asks[:2]], SPACE["initial"])
            self.assertEqual(len({tuple(a["x"]) for a in asks}), 14)
            for a in asks:
                x = a["x"]
                self.assertTrue(2 <= x[0] <= 29 and 1 <= x[1] <= 20 and -1 <= x[2] <= 1)
                self.assertTrue(x[0] + x[1] <= 20 and -15 <= x[1] - x[0] <= 12)
                self.assertEqual((x[0] * 2 % 1, x[1] * 2 % 1), (0, 0))
            answers = {tuple(a["x"]): measure(a["x"]) for a in asks}
            self.assertEqual((set(last), last["values"]), ({"front", "hypervolume", "values"}, "as reported"))
            for point in last["front"]:
                self.assertEqual(point["y"], answers[tuple(point["x"])])
                self.assertFalse(
                    any(y[0] >= point["y"][0] and y[1] <= point["y"][1] and y != point["y"] for y in answers.values())
                )
            total, level = 0.0, 2.0  # the staircase by hand
            for f1, f2 in sorted((p["y"] for p in last["front"]), reverse=True):
                if f1 > -0.06 and f2 < level:
                    total, level = total + (f1 + 0.06) * (level - f2), f2
            self.assertAlmostEqual(last["hypervolume"], total, places=12)

    def test_same_input_same_bits(self):
        self.assertEqual(self.whole_run(), self.whole_run())
        self.assertNotEqual(self.whole_run(), self.whole_run(dict(SPACE, seed=2)))

    def test_failures(self):
        session = self.session()
        first = session.read()["ask"]
        session.say({"fail": {"id": first["id"], "retry": False, "why": "no mesh"}})
        second = session.read()["ask"]
        session.say({"fail": {"id": second["id"], "retry": True, "why": "killed"}})
        again = session.read()["ask"]
        self.assertEqual((again["x"], again["id"]), (second["x"], second["id"] + 1))
        session.answer(again)
        asks, last = session.finish()
        self.assertEqual(len(asks), 13)  # 14 successful ones are wanted
        self.assertNotIn(first["x"], [a["x"] for a in asks])
        self.assertEqual(session.end()[0], 0)

    def test_resume_at_every_line(self):
        session = self.session()
        asks, last = session.finish()
        self.assertEqual(session.end()[0], 0)
        lines = self.transcript.read_text().splitlines(keepends=True)
        self.assertEqual(len(lines), 1 + 2 * 14)
        for cut in range(len(lines) + 1):
            for torn in ["", lines[cut][: len(lines[cut]) // 2] if cut < len(lines) else ""]:
                self.transcript.write_text("".join(lines[:cut]) + torn)
                resumed = self.session()
                rest, end = resumed.finish()
                self.assertEqual(resumed.end(), (0, "", ""))
                self.assertEqual(end, last)
                self.assertEqual(rest, asks[max(0, cut - 1) // 2 :] if cut < len(lines) else [])
                self.assertEqual(self.transcript.read_text(), "".join(lines))

    def test_kill_at_any_time(self):
        asks, last = self.whole_run()
        rng, kills = random.Random(3), 0
        end = None
        while end is None:
            session = self.session()
            deadline = time.monotonic() + rng.uniform(0.0, 0.1)
            while time.monotonic() < deadline or kills >= 25:
                message = session.read()
                if message is None or "ask" not in message:
                    end = message
                    break
                session.answer(message["ask"])
            if end is None:
                session.process.send_signal(signal.SIGKILL)
                kills += 1
            session.process.wait()
        self.assertEqual(end, last)
        events = [json.loads(line) for line in self.transcript.read_text().splitlines()]
        self.assertEqual([e["ask"] for e in events if "ask" in e], asks)
        self.assertEqual([e["tell"]["id"] for e in events if "tell" in e], list(range(14)))

    def test_bad_answers(self):
        for message, words in [
            ("nonsense", ["not JSON"]),
            ("{", ["not JSON"]),
            ("[]", ["object"]),
            ("{}", ["tell"]),
            ('{"tell":{"id":2,"y":[NaN,1]}}', ["NaN"]),
            ('{"tell":{"id":2,"y":[1e999,1]}}', ["finite"]),
            ('{"tell":{"id":2,"y":[null,1]}}', ["null"]),
            ('{"tell":{"id":2,"y":["1",1]}}', ["finite"]),
            ('{"tell":{"id":2,"y":[1]}}', ["1 values", "2"]),
            ('{"tell":{"id":2,"y":[1,2,3]}}', ["3 values"]),
            ('{"tell":{"id":2}}', ["y"]),
            ('{"tell":{"y":[1,2]}}', ["id"]),
            ('{"tell":{"id":9,"y":[1,2]}}', ["trial 9", "never asked"]),
            ('{"tell":{"id":-1,"y":[1,2]}}', ["never asked"]),
            ('{"tell":{"id":1,"y":[1,2]}}', ["trial 1", "answered before"]),
            ('{"tell":{"id":2.5,"y":[1,2]}}', ["whole number"]),
            ('{"tell":{"id":2,"y":[1,2],"z":1}}', ["unknown key", "z"]),
            ('{"answer":{"id":2,"y":[1,2]}}', ["unknown key", "answer"]),
            ('{"fail":{"id":2,"retry":"no"}}', ["retry"]),
            ('{"fail":{"id":2,"why":3}}', ["why"]),
            ('{"tell":{"id":2,"y":[1,2]},"fail":{"id":2}}', ["tell", "fail"]),
            ('{"tell":{"id":99999999999999999999,"y":[1,2]}}', ["id"]),
            ('{"tell":{"id":2,"y":[1,2]},"tell":{"id":2,"y":[1,3]}}', ['"tell" twice']),
            ('{"tell":{"id":9,"y":[1,2],"id":2}}', ['"id" twice']),
            ('\ufeff{"tell":{"id":2,"y":[1,2]}}', ["byte order mark"]),
        ]:
            with self.subTest(message):
                self.transcript.unlink(missing_ok=True)
                session = self.session()
                for _ in range(2):
                    session.answer(session.read()["ask"])
                third = session.read()["ask"]
                before = self.transcript.read_bytes()
                session.say(message)
                code, out, err = session.end()
                self.assertEqual((code, out), (BAD_FILE, ""), err)
                self.assertEqual(err.count("\n"), 1)
                for word in words + ["line 3"]:
                    self.assertIn(word, err)
                self.assertEqual(self.transcript.read_bytes(), before)
                resumed = self.session()
                self.assertEqual(resumed.read()["ask"], third)
                self.assertEqual(resumed.end()[0], BAD_FILE)

    def test_end_of_input(self):
        session = self.session()
        session.answer(session.read()["ask"])
        session.read()
        code, out, err = session.end()
        self.assertEqual((code, out), (BAD_FILE, ""))
        for word in ["standard input ended", "1 of 14", "run.jsonl"]:
            self.assertIn(word, err)

    def test_another_space_is_refused(self):
        session = self.session()
        session.answer(session.read()["ask"])
        session.end()
        before = self.transcript.read_bytes()
        for change, words in [
            (lambda s: s["variables"][1].update(upper=19), ["variables[1].upper is 19, was 20"]),
            (lambda s: s["variables"].pop(), ["initial", "variables"]),
            (lambda s: s["objectives"][0].update(goal="minimize"), ["objectives[0].goal", "maximize"]),
            (lambda s: s.pop("constraints"), ["constraints has 0 entries, had 2"]),
            (lambda s: s["initial"].pop(), ["initial has 1 entries, had 2"]),
        ]:
            space = copy.deepcopy(SPACE)
            change(space)
            code, out, err = self.session(space).end()
            self.assertEqual((code, out), (BAD_FILE, ""), err)
            self.assertEqual(err.count("\n"), 1)
            self.assertTrue(any(word in err for word in words), err)
        self.assertEqual(self.transcript.read_bytes(), before)

    def test_more_evaluations_are_those_of_one_search(self):
        asks, last = self.whole_run()
        first, _ = (session := self.session(dict(SPACE, evaluations=9))).finish()
        self.assertEqual(session.end(), (0, "", ""))
        rest, end = (session := self.session()).finish()
        code, _, err = session.end()
        self.assertEqual((code, err.count("\n")), (0, 1), err)
        self.assertIn("evaluations is 14, was 9", err)
        self.assertEqual((first + rest, end), (asks, last))
        spaces = [json.loads(l)["space"] for l in self.transcript.read_text().splitlines() if "space" in json.loads(l)]
        self.assertEqual([s["evaluations"] for s in spaces], [9, 14])
        again, end = (session := self.session()).finish()  # nothing has changed since
        self.assertEqual((again, end, session.end()), ([], last, (0, "", "")))
        none, fewer = (session := self.session(dict(SPACE, evaluations=5))).finish()
        self.assertEqual((none, fewer["front"], session.end()[0]), ([], last["front"], 0))

    def test_what_may_change(self):
        self.transcript.unlink(missing_ok=True)
        asks, _ = (session := self.session(dict(SPACE, evaluations=9))).finish()
        session.end()
        for change in [
            lambda s: s.update(seed=2),
            lambda s: s.update(source="default"),
            lambda s: s.update(sobol=8),
            lambda s: s.update(failures=0.9),
            lambda s: (s["objectives"][0].update(name="gain"), s["objectives"][1].update(reference=1.5)),
            lambda s: (
                s["variables"][0].update(name="b"),
                s["variables"][1].update(name="a"),
                s["constraints"][1].update(terms={"a": 1, "b": -1}),
            ),
        ]:
            before = self.transcript.read_bytes()
            space = dict(copy.deepcopy(SPACE), evaluations=11)
            change(space)
            rest, end = (session := self.session(space)).finish()
            self.assertEqual(session.end()[0], 0)
            self.assertEqual([a["id"] for a in rest], [9, 10])
            self.assertEqual(len({tuple(a["x"]) for a in asks + rest}), 11)
            self.transcript.write_bytes(before)

    def test_failures_end_a_search(self):
        for retry, most in [(False, 5), (True, 5)]:
            for share, end in [(None, 5), (1, 40)]:
                space = dict(SPACE, **({} if share is None else {"failures": share}))
                session = self.session(space, keep=False)
                asked = 0
                while "ask" in (message := session.read()) and asked < 40:
                    asked += 1
                    session.say({"fail": {"id": message["ask"]["id"], "retry": retry, "why": "no licence"}})
                self.assertEqual(asked, end)
                if share is None:
                    self.assertEqual(message, {"front": [], "hypervolume": 0.0, "values": "as reported"})
                    code, _, err = session.end()
                    self.assertEqual((code, err.count("\n")), (4, 1), err)
                    for word in ["5 of 5 evaluations failed", "50 %", "no licence"]:
                        self.assertIn(word, err)

    def test_an_outlier_is_named_and_spoils_nothing(self):
        space = {
            "variables": [{"name": "a", "lower": -5, "upper": 10}, {"name": "b", "lower": 0, "upper": 15}],
            "objectives": [{"name": "f", "goal": "minimize", "reference": 310}],
            "sobol": 8,
            "evaluations": 30,
        }

        def branin(a, b):
            p = math.pi
            return (b - 5.1 / (4 * p * p) * a * a + 5 / p * a - 6) ** 2 + 10 * (1 - 1 / (8 * p)) * math.cos(a) + 10

        found = {}
        for answer in [{"y": [1e12]}, {"y": [1e4]}, {"y": [-1e9]}, None]:
            session = self.session(space, keep=False)
            asks = []
            while "ask" in (message := session.read()):
                asks.append(message["ask"]["x"])
                if len(asks) == 5:
                    session.say(
                        {"tell": dict(answer, id=4)} if answer else {"fail": {"id": 4, "retry": False, "why": "blew up"}}
                    )
                else:
                    session.say({"tell": {"id": len(asks) - 1, "y": [branin(*asks[-1])]}})
            code, _, err = session.end()
            self.assertEqual(code, 0, err)
            others = [x for k, x in enumerate(asks) if k != 4]
            self.assertLess(min(branin(*x) for x in others), 0.5)
            found[str(answer)] = others
            if answer:
                self.assertEqual(err.count("\n"), 1, err)
                self.assertIn("trial 4: f = ", err)
                self.assertIn("outlier", err)
            if answer == {"y": [-1e9]}:
                self.assertEqual(message["front"], [{"x": asks[4], "y": [-1e9]}])  # as it was answered
        # One that is absurdly bad is a failure, but for the budget.
        self.assertEqual(found["{'y': [1000000000000.0]}"], found["None"][:29])
        self.assertEqual(found["{'y': [10000.0]}"], found["None"][:29])

    def test_known_results(self):
        """Off the lattice, outside the bounds, twice, from the space and from a table: never asked, reported apart."""
        space = {
            "variables": [{"name": "a", "lower": 0, "upper": 10, "step": 0.5}, {"name": "b", "lower": 0, "upper": 1}],
            "objectives": [{"name": "f", "goal": "minimize", "reference": 200}],
            "known": [[[5.23, 0.2], [5.2]], [[5.0, 1.002], [5.0], [0.1]], [[3, 0], [0.0]], [[3, 0], [0.0]]],
            "sobol": 2,
            "evaluations": 5,
            "noise": "none",
        }
        table = pathlib.Path(self.folder.name) / "known.csv"
        for rows, code, words in [
            ("f;a;b\n1,5;4,5;0,5\n", 0, []),
            ("a,b\n1,2\n", BAD_FILE, ["column 'f' is missing"]),
            ("a,b,f\n1,2,nan\n", BAD_FILE, ["nan", "finite"]),
            ("a,b,f,f_err\n1,0.5,2,-1\n", BAD_FILE, ["line 2", "-1"]),
        ]:
            table.write_text(rows)
            session = self.session(space, False, ["--known", str(table)])
            if code:
                ended, out, err = session.end()
                self.assertEqual((ended, out, err.count("\n")), (code, "", 1), err)
                self.assertTrue(all(w in err for w in words), err)
                continue
            designs = []
            while "ask" in (message := session.read()):
                designs.append(message["ask"]["x"])
                session.say({"tell": {"id": message["ask"]["id"], "y": [(designs[-1][0] - 3) ** 2 + designs[-1][1]]}})
            self.assertEqual(session.end(), (0, "", ""))
            self.assertEqual(len(designs), 5)
            self.assertTrue(all(x[0] * 2 % 1 == 0 and 0 <= x[1] <= 1 and x != [3, 0] for x in designs))
            self.assertIn({"x": [3.0, 0.0], "y": [0.0], "known": 2}, message["front"])

    def test_an_initial_design_as_it_was_written(self):
        space = dict(copy.deepcopy(SPACE), initial=[[6.25, 6, 0], [6, 6, 1.002]], evaluations=7)
        asks, last = (session := self.session(space)).finish()
        self.assertEqual([a["x"] for a in asks[:2]], space["initial"])
        code, out, err = session.end()
        self.assertEqual((code, err.count("\n")), (0, 2), err)
        self.assertTrue("initial[0]" in err and "0.5" in err and "initial[1]" in err and "upper bound" in err, err)
        self.assertTrue(all(p["x"] != space["initial"][1] for p in last["front"]))
        rest, _ = (session := self.session(dict(space, evaluations=8))).finish()  # goes on
        self.assertEqual(([a["id"] for a in rest], session.end()[0]), ([7], 0))

    def test_noise(self):
        """Where values carry noise the front is of means with their interval, which is said beside it."""
        space = {
            "variables": [{"name": "a", "lower": 0, "upper": 1}],
            "objectives": [{"name": "f", "goal": "maximize", "reference": 0}],
            "repeats": 2,
            "sobol": 6,
            "evaluations": 20,
            "source": "paper",
        }
        state = 12345

        def noise():
            nonlocal state
            total = 0.0
            for _ in range(12):  # nearly normal
                state = (1103515245 * state + 12345) % 2**31
                total += state / 2**31
            return 0.2 * (total - 6)

        for error in (None, 0.2):
            session = self.session(space)
            while "ask" in (message := session.read()):
                x = message["ask"]["x"][0]
                tell = {"id": message["ask"]["id"], "y": [1 - 4 * (x - 0.4) ** 2 + noise()]}
                session.say({"tell": dict(tell, **({} if error is None else {"y_err": [error]}))})
            self.assertEqual(session.end(), (0, "", ""))
            self.assertIn("means of the models", message["values"])
            self.assertIn("f", message["values"])
            low, high = message["interval_90"]
            self.assertTrue(low <= message["hypervolume"] <= high)
            self.assertTrue(0.8 < message["hypervolume"] < 1.2, message)
            self.assertTrue(0 < message["front"][0]["y_err"][0] < 0.2, message)
            again = self.session(space).read()  # from the transcript alone
            self.assertEqual(again, message)
            self.transcript.unlink()

    def test_lattice_nodes_as_they_were_typed(self):
        space = {
            "variables": [
                {"name": "a", "lower": -1.3, "upper": 1.3, "step": 0.1},
                {"name": "n", "lower": -3, "upper": 4, "step": 1},
            ],
            "objectives": [{"name": "f", "goal": "maximize", "reference": 0}],
            "evaluations": 30,
            "sobol": 30,
        }
        session = self.session(space)
        line = session.process.stdout.readline()
        values = []
        while '"ask"' in line:
            values.append(line[line.index("[") : line.index("]")])
            session.say({"tell": {"id": json.loads(line)["ask"]["id"], "y": [1.0]}})
            line = session.process.stdout.readline()
        self.assertEqual(len(values), 30)
        for pair in values:
            self.assertRegex(pair, r"^\[-?\d\.\d,-?\d$")

    def test_damage_never_passes_unnoticed(self):
        asks, last = (session := self.session()).finish()
        session.end()
        good = self.transcript.read_bytes()
        lines = good.splitlines(keepends=True)
        rng = random.Random(5)
        for k in range(120):
            damaged = bytearray(good)
            if k % 3 == 0:
                damaged[rng.randrange(len(good))] ^= 1 << rng.randrange(8)
            elif k % 3 == 1:
                begin = rng.randrange(len(good))
                del damaged[begin : begin + rng.randrange(1, 200)]
            else:
                a, b = rng.sample(range(len(lines)), 2)
                swapped = list(lines)
                swapped[a], swapped[b] = swapped[b], swapped[a]
                damaged = bytearray(b"".join(swapped))
            self.transcript.write_bytes(damaged)
            rest, end = (session := self.session()).finish()
            code, _, err = session.end()
            if code == 0:  # what was cut off at the end is asked again
                self.assertEqual((rest, end), (asks[len(asks) - len(rest) :], last))
                self.assertTrue(good.startswith(damaged.rpartition(b"\n")[0]), k)
            else:
                self.assertEqual((code, err.count("\n"), rest, end), (BAD_FILE, 1, [], None), err)
                self.assertEqual(self.transcript.read_bytes(), damaged)

    def test_a_transcript_without_digests_is_read_and_then_protected(self):
        asks, last = (session := self.session(dict(SPACE, evaluations=10))).finish()
        session.end()
        old = [dict(json.loads(l)) for l in self.transcript.read_text().splitlines()]
        for event in old:
            event.pop("digest")
        text = "".join(json.dumps(e, separators=(",", ":")) + "\n" for e in old)
        self.transcript.write_text(text)
        rest, _ = (session := self.session()).finish()
        self.assertEqual((len(rest), session.end()[0]), (4, 0))
        whole = self.transcript.read_text()
        self.assertTrue(whole.startswith(text))
        self.transcript.write_text(whole.replace('"y":[0.', '"y":[1.', 1))
        code, _, err = self.session().end()
        self.assertEqual(code, BAD_FILE)
        self.assertIn("damaged", err)

    def test_a_transcript_that_is_removed_renamed_or_replaced(self):
        elsewhere = self.transcript.with_name("elsewhere.jsonl")
        for how, words in [
            (lambda: self.transcript.unlink(), "removed"),
            (lambda: self.transcript.rename(elsewhere), "renamed"),
            (lambda: (self.transcript.rename(elsewhere), self.transcript.write_text("another")), "replaced"),
        ]:
            for path in pathlib.Path(self.folder.name).glob("*.jsonl*"):
                path.unlink()
            session = self.session()
            for _ in range(3):
                session.answer(session.read()["ask"])
            ask = session.read()["ask"]
            before = self.transcript.read_text()
            how()
            session.answer(ask)
            code, out, err = session.end()
            self.assertEqual((code, out, err.count("\n")), (BAD_FILE, "", 1), err)
            self.assertIn(words, err)
            rescued = self.transcript.with_name("run.jsonl.rescued-1")
            self.assertIn(str(rescued), err)
            kept = rescued.read_text()
            self.assertTrue(kept.startswith(before))
            self.assertEqual(json.loads(kept[len(before) :])["tell"], {"id": 3, "y": measure(ask["x"])})
            rescued.rename(self.transcript)
            self.assertEqual(self.session().read()["ask"]["id"], 4)

    def test_damaged_and_foreign_transcripts(self):
        session = self.session()
        session.finish()
        session.end()
        lines = self.transcript.read_text().splitlines(keepends=True)
        for text, words in [
            ("hello\nworld\n", ["transcript"]),
            ("".join(lines[:3] + ["garbage\n"] + lines[4:]), ["line 4"]),
            ("".join(lines[1:]), ["no transcript"]),
            ("".join(lines[:3] + lines[5:]), ["line 4"]),
            ("".join(lines[:3] + [lines[2]] + lines[3:]), ["line 4"]),
        ]:
            self.transcript.write_text(text)
            code, out, err = self.session().end()
            self.assertEqual((code, out), (BAD_FILE, ""), err)
            for word in words:
                self.assertIn(word, err)
            self.assertEqual(self.transcript.read_text(), text)

    def test_refused_files_are_not_cut(self):
        self.transcript.write_text('{"a":1}\n{"b":2}')
        code, out, err = self.session().end()
        self.assertEqual((code, out), (BAD_FILE, ""), err)
        self.assertIn("does not begin with a space", err)
        self.assertEqual(self.transcript.read_text(), '{"a":1}\n{"b":2}')
        self.transcript.unlink()
        session = self.session()
        session.finish()
        session.end()
        torn = self.transcript.read_text().rstrip("\n")
        self.transcript.write_text(torn)
        code, out, err = self.session(dict(SPACE, initial=[])).end()
        self.assertEqual((code, out), (BAD_FILE, ""), err)
        self.assertIn("another space", err)
        self.assertEqual(self.transcript.read_text(), torn)

    def test_one_process_at_a_time(self):
        first = self.session()
        first.read()
        code, _, err = self.session().end()
        self.assertEqual(code, BAD_FILE)
        self.assertIn("in use", err)

    def test_exhausted_lattice(self):
        space = {
            "variables": [
                {"name": "a", "lower": 0, "upper": 1, "step": 0.1},
                {"name": "b", "lower": 0, "upper": 1, "step": 0.1},
            ],
            "constraints": [{"terms": {"a": 1, "b": 1}, "upper": 0.3}],
            "objectives": [
                {"name": "f", "goal": "maximize", "reference": 0},
                {"name": "g", "goal": "minimize", "reference": 1},
            ],
            "evaluations": 40,
            "sobol": 3,
        }
        session = self.session(space)
        asks = []
        while "ask" in (message := session.read()):
            x = message["ask"]["x"]
            asks.append(tuple(x))
            session.say({"tell": {"id": message["ask"]["id"], "y": [x[0], x[1]]}})
        code, _, err = session.end()
        self.assertEqual(code, 0)
        self.assertIn("every feasible design", err)
        self.assertEqual(len(asks), 10)
        self.assertEqual(len(set(asks)), 10)
        self.assertIn((0.3, 0.0), asks)

    def outcome(self, space, measure):
        """Answers a whole run with `measure`; returns designs, values, and the last line."""
        session = self.session(dict({"sobol": 4, "evaluations": 16, "seed": 1}, **space), keep=False)
        designs, values = [], []
        while "ask" in (message := session.read()):
            designs.append(message["ask"]["x"])
            values.append(measure(designs[-1]))
            session.say({"tell": {"id": message["ask"]["id"], "y": values[-1]}})
        self.assertEqual(session.end(), (0, "", ""))
        self.assertEqual(len(designs), 16)
        self.assertEqual(len({tuple(x) for x in designs}), 16)
        return designs, values, message

    def check_front(self, space, designs, values, last):
        """Front and hypervolume against all pairs, and against the cells of the grid through all values."""
        goals = [1 if o["goal"] == "maximize" else -1 for o in space["objectives"]]
        points = [[g * v for g, v in zip(goals, y)] for y in values]
        reference = [g * o["reference"] for g, o in zip(goals, space["objectives"])]
        beaten = [any(all(a >= b for a, b in zip(q, p)) and q != p for q in points) for p in points]
        self.assertEqual(
            sorted((p["x"], p["y"]) for p in last["front"]),
            sorted((x, y) for x, y, b in zip(designs, values, beaten) if not b),
        )
        edges = [sorted({r} | {p[k] for p in points if p[k] > r}) for k, r in enumerate(reference)]
        volume = 0.0
        for cell in itertools.product(*[list(zip(e, e[1:])) for e in edges]):
            if any(all(v >= high for v, (low, high) in zip(p, cell)) for p in points):
                volume += math.prod(high - low for low, high in cell)
        self.assertGreater(volume, 0.0)
        self.assertAlmostEqual(last["hypervolume"] / volume, 1.0, places=10)

    def test_one_variable(self):
        space = {
            "variables": [{"name": "x", "lower": -2, "upper": 3}],
            "objectives": [{"name": "f", "goal": "minimize", "reference": 30}],
        }
        designs, values, last = self.outcome(space, lambda x: [(x[0] - 1.3) ** 2 + 2])
        self.check_front(space, designs, values, last)
        self.assertAlmostEqual(last["front"][0]["x"][0], 1.3, delta=0.05)

    def test_equality_on_a_lattice(self):
        space = {
            "variables": [{"name": n, "lower": 0, "upper": 3, "step": 0.1} for n in "abcdef"],
            "constraints": [{"terms": {n: 1 for n in "abcdef"}, "lower": 6, "upper": 6}],
            "objectives": [
                {"name": "f", "goal": "maximize", "reference": -20},
                {"name": "g", "goal": "minimize", "reference": 20},
            ],
        }
        designs, values, last = self.outcome(space, lambda x: [x[0] - (x[1] - 1) ** 2, (x[0] - 2) ** 2 + x[2]])
        for x in designs:
            self.assertAlmostEqual(sum(x), 6.0, places=9)
            self.assertTrue(all(v == round(v, 1) and 0 <= v <= 3 for v in x), x)
        self.check_front(space, designs, values, last)

    def test_continuous(self):
        space = {
            "variables": [{"name": n, "lower": 0, "upper": 1} for n in "xyz"],
            "constraints": [{"terms": {"x": 1, "y": 2}, "lower": 0.5, "upper": 1.5}],
            "objectives": [
                {"name": "f", "goal": "maximize", "reference": -1},
                {"name": "g", "goal": "maximize", "reference": -1},
            ],
        }
        designs, values, last = self.outcome(space, lambda x: [x[0] - x[2] ** 2, x[1] - (x[2] - 0.5) ** 2])
        for x in designs:
            self.assertTrue(all(0 <= v <= 1 for v in x) and 0.5 - 1e-12 <= x[0] + 2 * x[1] <= 1.5 + 1e-12, x)
        self.assertGreater(len({v for x in designs for v in x}), 3 * 12)  # on no lattice
        self.check_front(space, designs, values, last)

    def test_three_objectives(self):
        space = {
            "variables": [{"name": n, "lower": 0, "upper": 1, "step": 0.05} for n in "xyz"],
            "objectives": [
                {"name": "f", "goal": "maximize", "reference": -1},
                {"name": "g", "goal": "minimize", "reference": 2},
                {"name": "h", "goal": "maximize", "reference": 0.1},
            ],
        }
        designs, values, last = self.outcome(
            space, lambda x: [x[0] - x[1] ** 2, (x[0] - 0.2) ** 2 + x[2], x[1] + 0.5 * x[2]]
        )
        self.check_front(space, designs, values, last)
        self.assertGreater(len(last["front"]), 3)

    def test_interrupt(self):
        session = self.session()
        session.answer(session.read()["ask"])
        ask = session.read()["ask"]
        session.process.send_signal(signal.SIGINT)
        self.assertEqual(session.process.wait(timeout=10), 130)
        self.assertEqual(self.session().read()["ask"], ask)


class Refusals(unittest.TestCase):
    def refused(self, code, words, text=None, arguments=None):
        with self.subTest(str(text or arguments)[:100]), tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "space.json"
            if text is not None:
                path.write_text(text if isinstance(text, str) else json.dumps(text))
            done = subprocess.run(
                [LUMO, "optimize"] + (arguments if arguments is not None else ["--space", str(path)]),
                capture_output=True,
                text=True,
                timeout=60,
                input="",
            )
            self.assertEqual(done.returncode, code, done.stderr)
            self.assertEqual(done.stdout, "")
            self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
            for word in words:
                self.assertIn(word, done.stderr)

    def test_usage(self):
        self.refused(USAGE, ["--space"], arguments=[])
        self.refused(USAGE, ["--theta"], arguments=["--space", "x", "--theta", "1"])
        self.refused(USAGE, ["--space"], arguments=["--space", ""])
        self.refused(BAD_FILE, ["/nowhere/space.json"], arguments=["--space", "/nowhere/space.json"])
        self.refused(BAD_FILE, ["/proc/self/mem", "cannot be read"], arguments=["--space", "/proc/self/mem"])
        self.refused(BAD_FILE, ["/dev/zero", "bytes"], arguments=["--space", "/dev/zero"])
        self.refused(BAD_FILE, ["cannot be read", "directory"], arguments=["--space", "/"])
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "space.json"
            path.write_text(json.dumps(SPACE))
            self.refused(
                BAD_FILE, ["/nowhere/run.jsonl"], arguments=["--space", str(path), "--transcript", "/nowhere/run.jsonl"]
            )
            self.refused(
                BAD_FILE, ["not a regular file"], arguments=["--space", str(path), "--transcript", "/dev/null"]
            )

    def test_space_files(self):
        def changed(change):
            space = copy.deepcopy(SPACE)
            change(space)
            return space

        for text, words in [
            ("", ["not JSON"]),
            ("[]", ["object"]),
            ('{"variables":[{"name":"a","lower":NaN}]}', ["not JSON"]),
            (changed(lambda s: s.update(frobnicate=1)), ["unknown key", "frobnicate"]),
            (changed(lambda s: s.pop("variables")), ["variables is missing"]),
            (changed(lambda s: s.update(variables=[])), ["variables", "at least 1"]),
            (changed(lambda s: s.update(objectives={})), ["objectives", "list"]),
            (changed(lambda s: s["variables"][0].update(lower=30)), ["variables[0]", "30", "29"]),
            (changed(lambda s: s["variables"][0].update(step=0)), ["variables[0].step", "> 0"]),
            (changed(lambda s: s["variables"][0].update(step="x")), ["variables[0].step", "number"]),
            (changed(lambda s: s["variables"][0].update(unit="mm")), ["unknown key", "unit"]),
            (changed(lambda s: s["variables"][1].update(name="a")), ["a", "twice"]),
            (changed(lambda s: s["constraints"][0]["terms"].update(zz=1)), ["zz", "no variable"]),
            (changed(lambda s: s["constraints"][0].pop("upper")), ["constraints[0]", "neither"]),
            (changed(lambda s: s["objectives"][0].update(goal="best")), ["goal", "maximize"]),
            (changed(lambda s: s["objectives"][0].pop("reference")), ["objectives[0].reference", "missing"]),
            (changed(lambda s: s["initial"][0].pop()), ["initial[0]", "2 values", "3"]),
            (changed(lambda s: s.update(initial=[[1e9, 6, 0]])), ["initial[0]", "1e+09", "million widths"]),
            (changed(lambda s: s.update(known=[[[6, 6, 0]]])), ["known[0]", "1 entries", "[x, y, y_err]"]),
            (changed(lambda s: s.update(known=[[[6, 6], [1, 2]]])), ["known[0][0]", "2 values", "3"]),
            (changed(lambda s: s.update(known=[[[6, 6, 0], [1, 2], [1, -2]]])), ["known[0][2]", "-2"]),
            (changed(lambda s: s.update(noise="much")), ["noise", "much", "estimated"]),
            (changed(lambda s: s.update(repeats=0)), ["repeats", "0", "1000"]),
            (changed(lambda s: s.update(repeats=2, noise="none")), ["2 times", "no noise"]),
            (changed(lambda s: s.update(initial=[[12, 9, 0]])), ["initial[0]", "21", "20"]),
            (changed(lambda s: s.update(sobol=-1)), ["sobol", "-1"]),
            (changed(lambda s: s.update(evaluations=2.5)), ["evaluations", "2.5"]),
            (changed(lambda s: s.pop("evaluations")), ["evaluations is missing"]),
            (changed(lambda s: s.update(seed=-1)), ["seed"]),
            (json.dumps(SPACE).replace('"sobol": 4', '"sobol": 4, "sobol": 5'), ['"sobol" twice']),
            (changed(lambda s: s.update(failures=1.5)), ["failures", "1.5", "0 to 1"]),
            (b"\xef\xbb\xbf".decode() + json.dumps(SPACE), ["byte order mark"]),
            (changed(lambda s: s.update(source="best")), ["source", "paper", "default"]),
            (changed(lambda s: s["constraints"].append({"terms": {"a": 1}, "upper": 1})), ["initial[0]"]),
            (
                changed(lambda s: (s.update(initial=[]), s["constraints"].append({"terms": {"a": 1}, "upper": 1}))),
                ["no feasible design"],
            ),
        ]:
            self.refused(BAD_FILE, ["space.json"] + words, text)


if __name__ == "__main__":
    LUMO = os.path.abspath(sys.argv.pop(1))
    unittest.main()
