"""`lumo campaign report` from outside: what is written, and how it looks in a browser.

usage: test_report.py path/to/lumo path/to/make_store path/to/chromium folder-for-stores-pages-and-screenshots
"""

import csv
import functools
import html.parser
import io
import json
import math
import pathlib
import shutil
import subprocess
import sys
import time
import unittest

from browser import Browser
from refusal import check_refusal

LUMO = MAKE_STORE = CHROMIUM = ""
FOLDER = pathlib.Path()
USAGE, BAD_FILE = 2, 5
STORES = {"DS_flat": 14, "DS_curved": 14, "Sol_flat": 16, "Sol_curved": 16}  # successful evaluations
OLD_STORE, OLD_VERSION = "Sol_curved", 3  # its results are of another version
PLACES, BINS, SCENARIOS, LOADS = 7, 11, 28, 5


def run(*arguments, **options):
    return subprocess.run([LUMO, *map(str, arguments)], capture_output=True, text=True, timeout=600, **options)


def store(name):
    path = FOLDER / f"{name}.db"
    if not path.exists():
        material, ensemble, *more = name.split("_")
        more += [str(OLD_VERSION)] if name == OLD_STORE else []
        wanted = str(STORES.get(name, 14))
        subprocess.run([MAKE_STORE, path, material, ensemble, wanted, *more], check=True, timeout=300)
    return path


def report(page, *names, threads=2):
    done = run(
        "campaign",
        "report",
        "--json",
        "--quiet",
        "--threads",
        threads,
        "--out",
        page,
        *[word for name in names for word in ("--store", store(name))],
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@functools.cache
def one_campaign():
    page = FOLDER / "one.html"
    return page, report(page, "DS_flat", threads=1)


def parts_of(page):
    """A page's text before its data, the data, and the text behind."""
    head, start, rest = page.read_text().partition('<script type="application/json" id="data">')
    data, end, tail = rest.partition("</script>")
    return head + start, data, end + tail


def data_of(page):
    return json.loads(parts_of(page)[1])


def exported(name):
    return [
        t
        for t in json.loads(run("campaign", "export", "--json", "--store", store(name)).stdout)
        if t["state"] == "evaluated"
    ]


class Links(html.parser.HTMLParser):
    """What a page's elements would load or lead to."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found += [
            (tag, key, value)
            for key, value in attributes
            if key in ("src", "href", "srcset", "data", "poster", "action", "background")
        ]


def volume(points, triangles):
    """Enclosed by a closed surface."""
    total = 0.0
    for a, b, c in ([points[n] for n in t] for t in triangles):
        total += (
            a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
    return total / 6.0


def loop_area(points):
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(points, points[1:]))) / 2.0


def box(element):
    """Script for left, top, width and height of an element on the screen."""
    return f"(({{x, y, width, height}}) => [x, y, width, height])({element}.getBoundingClientRect())"


class Page(unittest.TestCase):
    def open(self, path, width=1280):
        self.browser.resize(width, 900)
        self.browser.open(path)
        state = self.browser.wait_for("document.documentElement?.dataset.state")
        self.assertEqual((state, self.browser.evaluate("problems")), ("ready", []))
        self.quiet()

    def quiet(self):
        """No complaints, nothing from outside."""
        self.assertEqual(
            [c for c in self.browser.complaints() if "willReadFrequently" not in c], []
        )  # a hint of Chromium to plotly
        for url in self.browser.requests():
            self.assertIn(url.split(":")[0], ("file", "data", "blob"), url)

    def setUp(self):
        self.browser = Browser(CHROMIUM)
        self.browser.__enter__()
        self.addCleanup(self.browser.__exit__)

    def plot(self, figure, expression):
        return self.browser.evaluate(
            f"(() => {{ const plot = document.querySelector('#{figure} .plot'); return {expression}; }})()"
        )

    def choose(self, selector, index):
        self.browser.evaluate(
            f"(() => {{ const s = document.querySelectorAll('{selector}')[0]; s.selectedIndex = {index}; s.dispatchEvent(new Event('change')); }})()"
        )

    def sentence(self, figure):
        return self.browser.evaluate(
            f"(() => {{ const p = document.querySelector('#{figure} p.note'); return p.hidden ? '' : p.textContent; }})()"
        )

    def csv(self, figure, name):
        """Clicks on the link and reads the file."""
        downloads = FOLDER / "downloads"
        shutil.rmtree(downloads, ignore_errors=True)
        downloads.mkdir()
        self.browser.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(downloads))
        self.browser.evaluate(f"document.querySelector('#{figure} button.csv').click()")
        path = downloads / f"{name}.csv"
        until = time.monotonic() + 30
        while not path.exists():
            self.assertLess(time.monotonic(), until, f"{name}.csv does not come")
            time.sleep(0.05)
        return list(csv.DictReader(io.StringIO(path.read_text())))


class OneCampaign(Page):
    @classmethod
    def setUpClass(cls):
        cls.page, cls.reported = one_campaign()
        cls.trials = exported("DS_flat")
        cls.best = next(t for t in cls.trials if t["selected"])

    def test_file(self):
        self.assertEqual(self.reported, {"page": str(self.page), "bytes": self.page.stat().st_size})
        links = Links()
        links.feed(self.page.read_text())
        self.assertEqual(links.found, [])

    def test_search(self):
        self.open(self.page)
        n = len(self.trials)
        self.assertEqual(n, STORES["DS_flat"])
        self.assertEqual(
            self.browser.evaluate("document.querySelectorAll('#pareto-figure .scatterlayer path.point').length"), n
        )
        marks = self.plot(
            "pareto-figure",
            "plot.data.filter((d) => d.mode === 'markers' && d.x.length > 0).map((d) => [d.name, d.x.length, d.marker.symbol])",
        )
        self.assertEqual(sum(m[1] for m in marks), n)
        self.assertEqual([m[1:] for m in marks if m[0] == "selected design"], [[1, "star"]])
        self.assertEqual(
            {m[0]: m[1] for m in marks if m[0] != "selected design"}.get("reference design", 0)
            + ("reference" == self.origin(self.best)),
            5,
        )

        rows = self.csv("pareto-figure", "pareto")
        self.assertEqual(
            [[float(r["J_contact"]), float(r["J_obs"]), int(r["on_front"]), float(r["w_v_mm"])] for r in rows],
            [
                [t["record"]["J_contact"], t["record"]["J_obs"], int(t["on_front"]), t["theta_mm"][4]]
                for t in self.trials
            ],
        )
        rows = self.csv("history-figure", "hypervolume")
        self.assertEqual([float(r["hypervolume"]) for r in rows], [t["hypervolume"] for t in self.trials])
        self.assertEqual(self.plot("history-figure", "plot.querySelectorAll('path.point').length"), n)
        self.assertEqual(self.plot("parallel-figure", "plot.data[0].dimensions.map((d) => d.values.length)"), [n] * 7)
        self.assertGreater(self.colours("parallel-figure"), 20)

        rows = self.csv("check-figure", "model_check")
        self.assertEqual(self.plot("check-figure", "plot.querySelectorAll('path.point').length"), 2 * n)
        caption = self.browser.evaluate("document.querySelector('#check-figure figcaption').textContent")
        for objective in ["J_contact", "J_obs"]:
            z = [
                (float(r["computed"]) - float(r["predicted"])) / float(r["predicted_deviation"])
                for r in rows
                if r["objective"] == objective
            ]
            self.assertEqual(len(z), n)
            share = 100 * sum(abs(v) <= 1.96 for v in z) / n
            self.assertIn(f"{objective}: {math.floor(share + 0.5)} % of {n} within the bars", caption)

    def origin(self, trial):
        return "reference" if trial["index"] < 5 else "sobol" if trial["index"] < 13 else "search"

    def colours(self, figure):
        """Number of colours in a picture of a chart: a blank one has few."""
        return self.browser.evaluate(f"""(async () => {{
          const image = new Image(), canvas = document.createElement('canvas');
          image.src = await Plotly.toImage(document.querySelector('#{figure} .plot'), {{format: 'png', width: 600, height: 400}});
          await image.decode();
          Object.assign(canvas, {{width: 600, height: 400}});
          const pen = canvas.getContext('2d', {{willReadFrequently: true}});
          pen.drawImage(image, 0, 0);
          const seen = new Set(), data = pen.getImageData(0, 0, 600, 400).data;
          for (let k = 0; k < data.length; k += 4) seen.add(data[k] << 16 | data[k + 1] << 8 | data[k + 2]);
          return seen.size;
        }})()""")

    def test_without_eyes_or_mouse(self):
        """Names on all controls and charts, headings in order, numbers as tables, keys in place of clicks (WCAG 2.1)."""
        self.open(self.page)
        unnamed = self.browser.evaluate("""[...document.querySelectorAll('.modebar-btn, .js-plotly-plot, button, select')]
          .filter((e) => !(e.ariaLabel || e.textContent.trim() || e.closest('label')?.textContent.trim()))
          .map((e) => e.outerHTML.slice(0, 80))""")
        self.assertEqual(unnamed, [])
        levels = self.browser.evaluate(
            "[...document.querySelectorAll('h1, h2, h3')].map((h) => [Number(h.tagName[1]), h.textContent.trim()])"
        )
        self.assertTrue(all(text for _, text in levels), levels)
        self.assertTrue(all(b[0] <= a[0] + 1 for a, b in zip(levels, levels[1:])), levels)
        charts = "[...document.querySelectorAll('figure')].filter((f) => !f.querySelector('.plot').hidden)"
        self.assertGreater(self.browser.evaluate(f"{charts}.length"), 6)
        self.browser.evaluate(f"{charts}.forEach((f) => {{ f.querySelector('details.numbers').open = true; }})")
        self.quiet()
        rows = self.browser.evaluate(f"{charts}.map((f) => f.querySelectorAll('details.numbers td').length)")
        self.assertTrue(all(n > 0 for n in rows), rows)
        cells = self.browser.evaluate(
            "[...document.querySelectorAll('#history-figure details.numbers tr')].map((r) => r.children.length)"
        )
        self.assertEqual(len(cells), len(self.trials) + 1)
        self.assertEqual(len(set(cells)), 1)
        # Zooming in by the keyboard alone.
        span = "plot.layout.xaxis.range[1] - plot.layout.xaxis.range[0]"
        before = self.plot("history-figure", span)
        self.browser.evaluate("""(() => {
          const button = document.querySelector("#history-figure .modebar-btn[data-val='in']");
          button.focus();
          button.dispatchEvent(new KeyboardEvent('keydown', {key: 'Enter', bubbles: true}));
        })()""")
        self.quiet()
        self.assertLess(self.plot("history-figure", span), before)

    def test_brushing(self):
        self.open(self.page)
        caption = "document.querySelector('#parallel-figure figcaption').textContent"
        self.assertEqual(self.browser.evaluate(caption), f"{len(self.trials)} designs.")
        self.browser.evaluate("document.getElementById('parallel-figure').scrollIntoView()")
        x, y, width, height = self.plot("parallel-figure", box("plot.querySelectorAll('.axis-brush')[1]"))
        for kind, at in [
            ("mouseMoved", 0.3),
            ("mousePressed", 0.3),
            ("mouseMoved", 0.5),
            ("mouseMoved", 0.7),
            ("mouseReleased", 0.7),
        ]:
            held = at > 0.3
            self.browser.call(
                "Input.dispatchMouseEvent",
                type=kind,
                x=x + width / 2,
                y=y + at * height,
                button="left" if held or kind != "mouseMoved" else "none",
                buttons=int(held),
                clickCount=1,
            )
            time.sleep(0.1)
        self.browser.wait_for(f"{caption}.includes('within the brushes')")
        low, high = self.plot("parallel-figure", "plot.data[0].dimensions[1].constraintrange")
        within = sum(low <= t["theta_mm"][1] <= high for t in self.trials)
        self.assertGreater(len(self.trials), within)
        self.assertTrue(
            self.browser.evaluate(caption).startswith(f"{within} of {len(self.trials)} designs within the brushes")
        )

    def test_hover_shows_errors(self):
        self.open(self.page)
        self.browser.evaluate("document.getElementById('pareto').scrollIntoView()")
        x, y, width, height = self.plot(
            "pareto-figure", box("[...plot.querySelectorAll('.scatterlayer path.point')].pop()")
        )
        self.browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + width / 2, y=y + height / 2)
        self.browser.wait_for(
            "document.querySelector('#pareto-figure .plot').data.some((d) => d.error_y && d.error_y.array.length === 1)"
        )
        shown = self.plot("pareto-figure", "plot.querySelector('.hoverlayer').textContent")
        self.assertIn(f"#{self.best['index']}, selected", shown)
        self.assertIn("± 0.0040", shown)

    def test_design(self):
        self.open(self.page)
        record, theta = self.best["record"], ",".join(map(str, self.best["theta_mm"]))
        self.assertIn(
            f"h_ep = {self.best['theta_mm'][1]:g} mm",
            self.browser.evaluate("document.querySelector('#section-figure svg').textContent"),
        )
        rows = self.csv("section-figure", "section")
        carrier = [float(r["z_mm"]) for r in rows if r["part"] == "carrier"]
        self.assertEqual(max(carrier), self.best["theta_mm"][3])

        self.assertEqual(self.plot("force-figure", "plot.data.length"), 4)
        self.assertEqual(len(self.csv("force-figure", "force_depth")), SCENARIOS * LOADS)
        here = [s for s in record["scenarios"] if s["y_mm"] == 0]
        self.assertEqual(
            self.plot("force-figure", "plot.data.map((d) => d.x)"),
            [[0] + [k["depth_mm"] for k in s["states"]] for s in here],
        )
        self.choose("#force-figure select", 0)
        there = [s for s in record["scenarios"] if s["y_mm"] == record["scenarios"][0]["y_mm"]]
        self.assertEqual(
            self.plot("force-figure", "plot.data.map((d) => d.x)"),
            [[0] + [k["depth_mm"] for k in s["states"]] for s in there],
        )

        z = self.plot("heat-figure", "plot.data[0].z")
        self.assertEqual((len(z), [len(row) for row in z]), (PLACES, [BINS] * PLACES))
        self.assertEqual(self.plot("heat-figure", "plot.data[0].zmin + plot.data[0].zmax"), 0)
        change = [
            [r - u for r, u in zip(s["states"][-1]["response"], record["unloaded_response"])]
            for s in record["scenarios"]
            if s["diameter_mm"] == 10
        ]
        scale = change[3][5] / z[3][5]
        for shown, wanted in zip(sum(z, []), sum(change, [])):
            self.assertAlmostEqual(shown * scale, wanted, delta=1e-12)
        rows = self.csv("heat-figure", "response")
        self.assertEqual(len(rows), SCENARIOS * LOADS * BINS)
        self.assertEqual([rows[0]["bin_y_mm"], rows[10]["bin_y_mm"]], ["-25", "25"])

        # The 3-D view is the boundary of the mesh that a press of this design has.
        mesh = json.loads(run("mesh", "--finger", "plain", "--theta", theta, "--json", "--quiet").stdout)
        triangles = self.plot("pad-figure", "(({i, j, k}) => i.map((n, t) => [n, j[t], k[t]]))(plot.data[0])")
        self.assertEqual(len(triangles), 4 * mesh["boundary_faces"])  # four for each curved face
        rows = self.csv("pad-figure", "pressed_pad")
        points = [[float(r[c]) for c in ("x_mm", "y_mm", "z_mm")] for r in rows]
        rest = [[float(r[c]) for c in ("rest_x_mm", "rest_y_mm", "rest_z_mm")] for r in rows]
        self.assertEqual(sorted({n for t in triangles for n in t}), list(range(len(rows))))
        self.assertAlmostEqual(
            volume(rest, triangles) / mesh["volume_mm3"], 1.0, delta=0.002
        )  # but for what four flat triangles leave out of a curved face
        self.assertAlmostEqual(
            volume(points, triangles) / volume(rest, triangles), 1.0, delta=0.01
        )  # silicone hardly gives way in volume
        press = json.loads(run("press", "--finger", "plain", "--theta", theta, "--json", "--quiet").stdout)
        depth = press["states"][-1]["depth_mm"] if "states" in press else press["scenario"]["states"][-1]["depth_mm"]
        apex = max(range(len(rest)), key=lambda n: (rest[n][2], -abs(rest[n][0]) - abs(rest[n][1])))
        self.assertAlmostEqual((rest[apex][2] - points[apex][2]) / depth, 1.0, delta=0.01)
        self.assertGreater(self.colours("pad-figure"), 50)
        self.choose("#pad-figure select", 1)
        self.assertIn(
            "sphere of 30 mm", self.browser.evaluate("document.querySelector('#pad-figure figcaption').textContent")
        )

        # Patches seen from above are a little smaller than on the curved surface, and grow with the load.
        rows = self.csv("patch-figure", "contact_patches")
        areas = {}
        for r in rows:
            areas.setdefault(
                (float(r["diameter_mm"]), float(r["load_N"]), float(r["reference_area_mm2"])), {}
            ).setdefault(r["loop"], []).append((float(r["y_mm"]), float(r["x_mm"])))
        self.assertEqual(len(areas), 2 * LOADS)
        for (_, _, wanted), loops in areas.items():
            self.assertTrue(all(loop[0] == loop[-1] for loop in loops.values()))
            seen = sum(map(loop_area, loops.values()))
            self.assertTrue(0.85 * wanted < seen < 1.01 * wanted, (seen, wanted))
        for d in (10, 30):
            grown = [a for (diameter, _, a) in areas if diameter == d]
            self.assertEqual(grown, sorted(grown))
        self.quiet()

    def test_screenshots(self):
        for width in (1280, 800):
            self.open(self.page, width)
            self.assertLessEqual(self.browser.evaluate("document.documentElement.scrollWidth"), width)
            self.browser.screenshot(FOLDER / f"one-{width}.png")
            self.assertGreater((FOLDER / f"one-{width}.png").stat().st_size, 100_000)

    def test_press_failed(self):
        page = FOLDER / "no_press.html"
        head, data, tail = parts_of(self.page)
        model = json.loads(data)
        for press in model["campaigns"][0]["design"]["presses"]:
            press["states"], press["note"] = [], "mesh: the mesher ran out of time"
        page.write_text(head + json.dumps(model).replace("<", "\\u003c") + tail)
        self.open(page)
        for figure in ["patch", "pad"]:
            self.assertEqual(
                self.sentence(f"{figure}-figure"),
                "The pad was not pressed for this page: mesh: the mesher ran out of time",
            )
        self.assertEqual(self.plot("force-figure", "plot.data.length"), 4)
        self.browser.screenshot(FOLDER / "no_press.png")


class Errors(Page):
    def test_a_search_that_knows_errors(self):
        page = FOLDER / "errors.html"
        report(page, "DS_flat_errors")
        trials = exported("DS_flat_errors")
        status = json.loads(run("campaign", "status", "--json", "--store", store("DS_flat_errors")).stdout)
        self.open(page)
        said = self.browser.evaluate("document.querySelector('p.values').textContent")
        self.assertIn("of values means of the models, as there is noise: J_contact, J_obs", said)
        self.assertIn("(90 %:", self.browser.evaluate("document.getElementById('campaigns').textContent"))
        self.assertEqual(data_of(page)["campaigns"][0]["interval_90"], status["interval_90"])
        rows = self.csv("pareto-figure", "pareto")
        self.assertEqual(
            [[float(r["J_contact_mean"]), float(r["J_obs_mean_err"])] for r in rows],
            [[t["J_contact_mean"], t["J_obs_mean_err"]] for t in trials],
        )
        front = [t["J_contact_mean"] for t in trials if t["on_front"]]
        line = self.plot("pareto-figure", "plot.data.find((d) => d.name === 'Pareto set').x")
        self.assertEqual(sorted(line[1:-1]), sorted(front))


class Campaigns(Page):
    def test_four(self):
        page = FOLDER / "four.html"
        report(page, *STORES)
        self.assertEqual(
            data_of(page)["campaigns"][0], data_of(one_campaign()[0])["campaigns"][0]
        )  # to the bit, from two threads and from one
        self.open(page)
        counts = [len(exported(name)) for name in STORES]
        self.assertEqual(counts, list(STORES.values()))
        self.assertEqual(
            self.browser.evaluate("document.querySelectorAll('#pareto-figure .scatterlayer path.point').length"),
            sum(counts),
        )
        stars = self.plot(
            "pareto-figure",
            "plot.data.filter((d) => d.name === 'selected design').map((d) => [d.x.length, d.marker.symbol, d.xaxis])",
        )
        self.assertEqual(stars, [[1, "star", x] for x in ("x", "x2", "x3", "x4")])
        self.assertEqual(
            self.plot("pareto-figure", "plot.layout.annotations.map((a) => a.text)"),
            ["<b>DS, flat</b>", "<b>Sol, flat</b>", "<b>DS, curved</b>", "<b>Sol, curved</b>"],
        )
        ranges = self.plot(
            "pareto-figure",
            "['', 2, 3, 4].map((n) => [plot.layout['xaxis' + n].range, plot.layout['yaxis' + n].range])",
        )
        self.assertEqual((ranges[0], ranges[1]), (ranges[2], ranges[3]))
        self.assertEqual(len(self.csv("pareto-figure", "pareto")), sum(counts))
        self.assertEqual(self.plot("history-figure", "plot.data[0].x.length"), counts[0])
        self.choose("#chooser select", 3)
        self.assertEqual(self.plot("history-figure", "plot.data[0].x.length"), counts[3])
        self.assertEqual(len(self.csv("force-figure", "force_depth")), 5 * SCENARIOS * LOADS)
        self.assertEqual(self.browser.evaluate("document.querySelectorAll('#provenance tr').length"), 5)
        foot = self.browser.evaluate("document.getElementById('provenance').textContent")
        self.assertEqual(
            foot.count(
                "lumo 0.1.0, 2 threads, an abacus, Linux 0, g++ 12, TetGen 1.5.0, Embree 3.13.5, CHOLMOD 3.0.14"
            ),
            4,
        )
        digests = [
            json.loads(run("campaign", "status", "--json", "--store", store(name)).stdout)["problem_digest"]
            for name in STORES
        ]
        self.assertEqual(len(set(digests)), 4)
        for digest in digests:
            self.assertIn(f"digest {digest}", foot)
        data = json.loads(self.browser.evaluate("document.getElementById('data').textContent"))
        versions = [c["results_version"] for c in data["campaigns"]]
        self.assertEqual(versions, [OLD_VERSION if name == OLD_STORE else data["results_version"] for name in STORES])
        self.assertNotEqual(OLD_VERSION, data["results_version"])
        self.browser.screenshot(FOLDER / "four-1280.png")
        self.quiet()

    def test_nothing_succeeded(self):
        path = FOLDER / "failed.db"
        path.unlink(missing_ok=True)
        subprocess.run([MAKE_STORE, path, "DS", "flat", "0"], check=True, timeout=60)
        page = FOLDER / "failed.html"
        done = run("campaign", "report", "--store", path, "--out", page)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertRegex(done.stdout, r"failed\.html: \d+\.\d MB\n$")
        self.open(page)
        for figure in ["pareto", "history", "parallel", "section", "force", "patch", "heat", "pad"]:
            self.assertRegex(self.sentence(f"{figure}-figure"), "No evaluation has succeeded|No design is selected")
        self.assertIn("fewer than five", self.sentence("check-figure"))
        self.assertEqual(
            self.browser.evaluate("document.querySelectorAll('.plot:not([hidden]), button.csv:not([hidden])').length"),
            0,
        )
        # Odd words of a store are shown as they are.
        said = self.browser.evaluate("[...document.querySelectorAll('#failures li')].map((e) => e.textContent)")
        self.assertEqual(len(said), 5)
        self.assertIn(
            '</script><img src=x onerror=alert(1)> & "quotes", {{script}}, no UTF-8: \N{REPLACEMENT CHARACTER}', said[0]
        )
        self.assertEqual(self.browser.evaluate("document.images.length"), 0)
        self.browser.screenshot(FOLDER / "failed.png")


class Refusals(unittest.TestCase):
    def refused(self, code, words, *arguments):
        check_refusal(self, run("campaign", "report", *arguments, cwd=FOLDER), code, words)

    def test_files(self):
        self.refused(USAGE, ["--store is missing"])
        self.refused(BAD_FILE, ["none.db"], "--store", "none.db")
        self.refused(BAD_FILE, ["none.db"], "--store", store("DS_flat"), "--store", "none.db")
        self.refused(BAD_FILE, ["directory"], "--store", store("DS_flat"), "--out", "pages/")
        (FOLDER / "taken.html").mkdir(exist_ok=True)  # refused before anything is pressed: there is no progress
        self.refused(BAD_FILE, ["taken.html", "directory"], "--store", store("DS_flat"), "--out", "taken.html")
        self.assertEqual([p.name for p in FOLDER.glob("pages*")], [])


if __name__ == "__main__":
    LUMO, MAKE_STORE, CHROMIUM = (str(pathlib.Path(p).resolve()) for p in sys.argv[1:4])
    FOLDER = pathlib.Path(sys.argv[4]).resolve()
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    unittest.main(argv=sys.argv[:1] + sys.argv[5:])
