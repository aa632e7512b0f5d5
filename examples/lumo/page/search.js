// What the search found: the table, and how the hypervolume grew.

const evaluated = (campaign) => campaign.trials.filter((t) => t.state === "evaluated" && isNumber(t.J_contact) && isNumber(t.J_obs));
const failed = (campaign) => campaign.trials.filter((t) => t.state === "failed");
const origins = [
  {key: "reference", label: "reference design", symbol: "square"}, {key: "sobol", label: "Sobol start", symbol: "diamond"},
  {key: "search", label: "proposed by the search", symbol: "circle"}
];
const trialHead = () =>
    ["index", ...report.variables.map((v) => `${v.name}_${v.unit}`), "origin", "J_contact", "J_contact_err", "J_obs", "J_obs_err",
     "on_front", "selected", ...(report.campaigns.some(hasMeans) ? ["J_contact_mean", "J_contact_mean_err", "J_obs_mean", "J_obs_mean_err"] : [])];
const trialRow =
    (t) => [t.index, ...t.theta_mm, t.origin, t.J_contact, t.J_contact_err, t.J_obs, t.J_obs_err, Number(t.on_front), Number(t.selected),
            ...(report.campaigns.some(hasMeans) ? [t.value[0], t.deviation[0], t.value[1], t.deviation[1]] : [])];

// Does a campaign's front stand on the models' means? An evaluation then has them beside what was reported.
const hasMeans = (campaign) => campaign.modelled.length > 0;
const hypervolumeText = (c) => c.interval_90 === null ?
    shown(c.hypervolume) :
    `${shown(c.hypervolume)} (90 %: ${c.interval_90.map((v) => shown(v)).join(" to ")})`;

function hoverText(t) {
  const mark = t.selected ? ", selected" : t.on_front ? ", on the front" : "";
  const means = isNumber(t.deviation[0]) ?
      `<br>means of the models: ${withError(t.value[0], t.deviation[0])} and ${withError(t.value[1], t.deviation[1])}` :
      "";
  return `#${t.index}${mark}<br>θ = ${thetaText(t.theta_mm)} mm<br>J_contact ${withError(t.J_contact, t.J_contact_err)}<br>J_obs ${
      withError(t.J_obs, t.J_obs_err)}${means}`;
}

function drawTable(campaigns) {
  const table = document.getElementById("campaigns");
  const head = element("tr");
  for (const h of ["campaign", "evaluated", "failed", "hypervolume", "selected θ [mm]", "J_contact", "J_obs"])
    head.append(element("th", h));
  table.append(head);
  for (const c of campaigns) {
    const row = element("tr"), best = c.trials.find((t) => t.selected);
    const cells = [
      c.name, evaluated(c).length, failed(c).length, hypervolumeText(c),
      ...(best ? [thetaText(best.theta_mm), withError(best.J_contact, best.J_contact_err), withError(best.J_obs, best.J_obs_err)] :
                 ["none yet", "–", "–"])
    ];
    for (const text of cells) row.append(element("td", text));
    table.append(row);
  }
  const all = campaigns.flatMap((c) => failed(c).map((t) => ({c, t})));
  if (all.length === 0) return;
  const details = element("details", "", {open: campaigns.every((c) => evaluated(c).length === 0)}), list = element("ul");
  details.append(element("summary", `${plural(all.length, "evaluation")} failed and ${all.length === 1 ? "is" : "are"} in no figure`));
  for (const {c, t} of all) list.append(element("li", `${c.name}, #${t.index}, θ = ${thetaText(t.theta_mm)} mm: ${t.why}`));
  details.append(list);
  document.getElementById("failures").append(details);
}

function makeHistory() {
  let campaign = null;
  const figure = new Figure(
      document.getElementById("history"), "history-figure", "", "hypervolume",
      () => [["evaluation", "index", "hypervolume"], ...evaluated(campaign).map((t, k) => [k + 1, t.index, t.hypervolume])]);
  return (c) => {
    campaign = c;
    const trials = evaluated(c);
    if (trials.length === 0) return figure.say("No evaluation has succeeded yet.");
    const {scale, title} = axisScale(trials.map((t) => t.hypervolume), "hypervolume", "W/W");
    const starts = trials.filter((t) => t.origin !== "search").length, count = trials.map((t, k) => k + 1);
    const y = trials.map((t) => t.hypervolume / scale), high = 1.08 * Math.max(...y) || 1;
    const layout = {
      height: 340,
      xaxis: axis(
          "successful evaluations",
          {range: [0, trials.length + 1], dtick: [1, 2, 5, 10, 20, 50, 100].find((d) => trials.length <= 12 * d)}),
      yaxis: axis(title, {range: [0, high]}),
      showlegend: false,
      shapes: [],
      annotations: []
    };
    if (starts < trials.length) {
      layout.shapes.push({
        type: "rect",
        xref: "x",
        yref: "paper",
        x0: 0,
        x1: starts + 0.5,
        y0: 0,
        y1: 1,
        fillcolor: "#f0f2f5",
        line: {width: 0},
        layer: "below"
      });
      layout.annotations.push({
        text: "starts",
        xref: "x",
        yref: "paper",
        x: 0.5 * (starts + 0.5),
        y: 1,
        yanchor: "bottom",
        showarrow: false,
        font: {color: soft, size: 12}
      });
    }
    figure.show(
        [{
          type: "scatter",
          mode: "lines+markers",
          x: count,
          y,
          line: {shape: "hv", color: blue, width: 2},
          marker: {size: 5, color: blue},
          hoverinfo: "text",
          text: trials.map((t, k) => `after ${plural(k + 1, "evaluation")} (#${t.index})<br>${shown(t.hypervolume, 4)}`)
        }],
        layout);
  };
}
