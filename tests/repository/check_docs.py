"""Makes the pages, warnings being errors, and opens those with equations from disk in a browser without a network.

usage: check_docs.py --generate docs/generate --folder DIR [--browser CHROMIUM] [--shots]
--shots leaves a picture of each page in DIR/shots.
"""

import argparse
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "cli"))
sys.dont_write_bytecode = True

# The least number of formulas on each page.
PAGES = {
    "index": 2,
    "page_solver": 30,
    "page_contact": 20,
    "page_optics": 20,
    "page_objectives": 10,
    "page_acquisition": 20,
    "page_estimator": 25,
    "page_own": 1,
    "page_assumptions": 0,
    "page_benchmarks": 0,
    "page_inclusion": 0,
}

# MathJax works through its queue; each formula leaves a script and, when it is understood, a picture.
DONE = "typeof MathJax !== 'undefined' && !!MathJax.Hub && new Promise(done => MathJax.Hub.Queue(() => done(true)))"
LOOK = """(() => ({
  formulas: document.querySelectorAll('script[type^="math/tex"]').length,
  drawn: document.querySelectorAll('.MathJax_SVG svg').length,
  errors: [...document.querySelectorAll('.noError, .merror, .MathJax_Error, .MathJax_SVG_Processing, ' +
                                        '[data-mathml*="merror"]')].map(e => e.textContent.slice(0, 80)),
  undefined_sequences: [...document.querySelectorAll('.MathJax_SVG')].map(e => e.textContent)
    .filter(t => t.includes('Undefined control')),
  wide: [...document.querySelectorAll('.contents table.markdownTable, .contents p, .contents .fragment')]
    .filter(e => e.getBoundingClientRect().right > innerWidth + 1 || e.scrollWidth > e.clientWidth + 1)
    .map(e => e.textContent.slice(0, 60))
}))()"""


def look(browser_program, html, shots):
    from browser import Browser

    faults = []
    with Browser(browser_program, seconds=300) as browser:
        browser.resize(1360, 900)
        for page, least in PAGES.items():
            browser.open(html / f"{page}.html")
            browser.wait_for(DONE)
            found = browser.evaluate(LOOK)
            if found["formulas"] < least or found["drawn"] != found["formulas"]:
                faults.append(
                    f"{page}: {found['drawn']} of {found['formulas']} formulas are drawn, "
                    f"at least {least} are expected"
                )
            for text in [*found["errors"], *found["undefined_sequences"]]:
                faults.append(f"{page}: a formula is not understood: {text}")
            for text in found["wide"]:
                faults.append(f"{page}: is wider than its place: {text!r}")
            faults += [f"{page}: {text}" for text in browser.complaints()]
            faults += [
                f"{page}: asks for {url}"
                for url in browser.requests()
                if not url.startswith(("file:", "data:", "about:"))
            ]
            if shots:
                shots.mkdir(parents=True, exist_ok=True)
                browser.resize(1360, 2600)
                browser.screenshot(shots / f"{page}.png")
                browser.resize(1360, 900)
            print(f"{page}: {found['drawn']} formulas", flush=True)
    return faults


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--generate", required=True)
    parser.add_argument("--folder", required=True)
    parser.add_argument("--browser")
    parser.add_argument("--shots", action="store_true")
    arguments = parser.parse_args()
    folder = pathlib.Path(arguments.folder).resolve()
    made = subprocess.run([sys.executable, arguments.generate, "--check", str(folder)])
    if made.returncode:
        sys.exit(made.returncode)
    shots = folder / "shots" if arguments.shots else None
    if arguments.browser and (found := look(arguments.browser, folder / "html", shots)):
        sys.exit("\n".join(found))
