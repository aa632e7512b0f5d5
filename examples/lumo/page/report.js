// Puts the page together from the data that it carries.

const report = JSON.parse(document.getElementById("data").textContent);
const problems = [];  // what went wrong, for whoever checks the page
window.addEventListener("error", (event) => problems.push(String(event.message)));
window.addEventListener("unhandledrejection", (event) => problems.push(String(event.reason)));

function drawHead(campaigns) {
  const one = campaigns.length === 1 ? campaigns[0] : null;
  document.querySelector("h1").textContent = one ?
      `Finger pads of ${one.material}, ${one.ensemble} contacts: a search for the best design` :
      `Searches for the best finger pad: ${plural(campaigns.length, "campaign")}`;
  document.getElementById("summary").textContent =
      "Designs of a soft, transparent finger pad that is lit from inside, each judged by simulation: spheres are pressed into the pad, and light is traced through it. " +
      "A Bayesian optimiser chose them so that both figures of merit become as large as they can together.";
  for (const c of campaigns.filter((c) => c.results_version !== report.results_version))
    document.getElementById("summary").after(element(
        "p",
        `The evaluations of ${c.name} are of version ${c.results_version} of the results, this lumo computes version ${
            report.results_version}: they cannot be compared with new ones, and the presses of the selected design below are new.`,
        {className: "version"}));
  for (const c of campaigns.filter((c) => hasMeans(c) || c.known !== ""))
    document.getElementById("failures").before(element(
        "p",
        [`${c.name}: front, hypervolume and selection are of values ${c.values}`, c.known].filter((t) => t !== "").join("; it ") + ".",
        {className: "values"}));
  drawTable(campaigns);
}

function drawProvenance(campaigns) {
  const foot = document.getElementById("provenance");
  const box = element("div", "", {className: "scroll"}), table = element("table");
  const row = (cells, tag) => {
    const r = element("tr");
    r.append(...cells.map((t) => element(tag, t)));
    table.append(r);
  };
  row(["campaign", "store", "digest", "seed", "candidates", "evaluated by", "time in evaluations"], "th");
  for (const c of campaigns) {
    const m = c.machine, by = [
      m.lumo.length > 0 ? `lumo ${m.lumo.join(", ")}` : "unknown",
      m.threads.length > 0 ? `${m.threads.join(", ")} thread${m.threads.length === 1 && m.threads[0] === 1 ? "" : "s"}` : "",
      ...m.machines
    ].filter((t) => t !== "").join(", ");
    row(
        [
          c.name, c.store, c.digest, c.seed, c.source, by,
          m.timed > 0 ? `${duration(m.seconds)}, ${duration(m.seconds / m.timed)} each` : "–"
        ],
        "td");
  }
  box.append(table);
  foot.append(
      box,
      element(
          "p",
          `Written by lumo ${report.lumo} with plotly.js ${
              report.plotly} (MIT licence). The same stores give the same page. To make it again:`),
      element("pre", report.command));
  for (const c of campaigns) {
    const details = element("details");
    details.append(element("summary", `The problem of ${c.name}, digest ${c.problem_digest}, as it stands in the store`), element("pre", c.problem));
    foot.append(details);
  }
}

function main() {
  const campaigns = report.campaigns;
  drawHead(campaigns);
  drawPareto(campaigns);
  const figures = [makeHistory(), makeParallel(), makeCheck(), makeSection(), makeForceDepth(), makePatches(), makeHeat(), makePad()];
  // A figure that fails leaves the others in place.
  const choose = (k) => figures.forEach((draw) => {
    try {
      draw(campaigns[k]);
    } catch (error) {
      problems.push(String(error));
      console.error(error);
    }
  });
  if (campaigns.length > 1) {
    const select = element("select"), label = element("label", "What follows is about ");
    select.append(...campaigns.map((c, k) => element("option", c.name, {value: k})));
    select.addEventListener("change", () => choose(select.selectedIndex));
    label.append(select);
    document.getElementById("chooser").append(label);
  }
  drawProvenance(campaigns);
  choose(0);
}

try {
  main();
} catch (error) {
  problems.push(String(error));
  throw error;
} finally {
  Promise.allSettled(pending).then(() => {
    document.documentElement.dataset.state = problems.length === 0 ? "ready" : "broken";
  });
}
