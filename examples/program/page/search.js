// What the search found: the table, the Pareto sets, the hypervolume.

const evaluated = (campaign) => campaign.trials.filter((t) => t.state === "evaluated" && isNumber(t.J_contact) && isNumber(t.J_obs));
const failed = (campaign) => campaign.trials.filter((t) => t.state === "failed");
const origins = [{key: "reference", label: "reference design", symbol: "square"}, {key: "sobol", label: "Sobol start", symbol: "diamond"}, {key: "search", label: "proposed by the search", symbol: "circle"}];
const trialHead = () => ["index", ...report.variables.map((v) => `${v.name}_${v.unit}`), "origin", "J_contact", "J_contact_err", "J_obs", "J_obs_err", "on_front", "selected"];
const trialRow = (t) => [t.index, ...t.theta_mm, t.origin, t.J_contact, t.J_contact_err, t.J_obs, t.J_obs_err, Number(t.on_front), Number(t.selected)];

function hoverText(t) {
  const mark = t.selected ? ", selected" : t.on_front ? ", on the front" : "";
  return `#${t.index}${mark}<br>θ = ${thetaText(t.theta_mm)} mm<br>J_contact ${withError(t.J_contact, t.J_contact_err)}<br>J_obs ${withError(t.J_obs, t.J_obs_err)}`;
}

function drawTable(campaigns) {
  const table = document.getElementById("campaigns");
  const head = element("tr");
  for (const h of ["campaign", "evaluated", "failed", "hypervolume", "selected θ [mm]", "J_contact", "J_obs"]) head.append(element("th", h));
  table.append(head);
  for (const c of campaigns) {
    const row = element("tr"), best = c.trials.find((t) => t.selected);
    const cells = [c.name, evaluated(c).length, failed(c).length, shown(c.hypervolume),
      ...(best ? [thetaText(best.theta_mm), withError(best.J_contact, best.J_contact_err), withError(best.J_obs, best.J_obs_err)] : ["none yet", "–", "–"])];
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

const range = (values, pad) => {
  const low = Math.min(...values), high = Math.max(...values), room = pad * (high - low || Math.abs(high) || 1);
  return [low - room, high + room];
};

// One panel for each campaign; those of one material share their axes.
function drawPareto(campaigns) {
  const figure = new Figure(document.getElementById("pareto"), "pareto-figure", "", "pareto", () =>
    [["material", "ensemble", ...trialHead()], ...campaigns.flatMap((c) => evaluated(c).map((t) => [c.material, c.ensemble, ...trialRow(t)]))]);
  const panels = campaigns.filter((c) => evaluated(c).some((t) => t.on_front)).sort((a, b) => b.ensemble.localeCompare(a.ensemble) || a.material.localeCompare(b.material));
  if (panels.length === 0) return figure.say("No evaluation has succeeded yet, so there is no Pareto set.");
  const {scale, title} = axisScale(panels.flatMap((c) => evaluated(c).map((t) => t.J_obs)), "J_obs", "W/W");
  const columns = Math.min(2, panels.length), rows = Math.ceil(panels.length / columns), single = panels.length === 1;
  const data = [], errors = [], annotations = [];
  const layout = {height: single ? 540 : 80 + 380 * rows, coloraxis: {colorscale: "Viridis", cmin: report.variables[4].lower, cmax: report.variables[4].upper, colorbar: {title: {text: "w_v [mm]", side: "right"}, thickness: 14, outlinewidth: 0}}, annotations};
  layout.legend = {orientation: "h", x: 0, y: single ? -0.14 : -0.16 / rows, xanchor: "left", yanchor: "top"};
  panels.forEach((c, p) => {
    const n = p === 0 ? "" : String(p + 1), column = p % columns, row = Math.floor(p / columns);
    const gap = single ? 0 : 0.11, width = (1 - gap * (columns - 1)) / columns, gapY = 0.2 / rows, height = (1 - gapY * (rows - 1)) / rows;
    const x0 = column * (width + gap), y1 = 1 - row * (height + gapY);
    const family = panels.filter((o) => o.material === c.material).flatMap(evaluated);
    const within = (key) => family.flatMap((t) => [t[key] - t[`${key}_err`], t[key] + t[`${key}_err`]]);   // no closer than the errors allow
    const xRange = range(within("J_contact"), 0.06), yRange = range(within("J_obs").map((v) => v / scale), 0.06);
    layout[`xaxis${n}`] = axis("J_contact [–]", {domain: [x0, x0 + width], anchor: `y${n}`, range: xRange});
    layout[`yaxis${n}`] = axis(title, {domain: [y1 - height, y1], anchor: `x${n}`, range: yRange});
    if (!single) annotations.push({text: `<b>${c.name}</b>`, xref: "paper", yref: "paper", x: x0, y: y1, xanchor: "left", yanchor: "bottom", showarrow: false, font: {size: 14}});
    const on = {xaxis: `x${n}`, yaxis: `y${n}`}, trials = evaluated(c), first = p === 0;
    const front = trials.filter((t) => t.on_front).sort((a, b) => a.J_contact - b.J_contact);
    data.push(Object.assign({type: "scatter", mode: "lines", name: "Pareto set", legendgroup: "front", showlegend: first, hoverinfo: "skip", line: {shape: "vh", color: soft, width: 1.6},
      x: [xRange[0], ...front.map((t) => t.J_contact), front[front.length - 1].J_contact], y: [front[0].J_obs / scale, ...front.map((t) => t.J_obs / scale), yRange[0]]}, on));
    for (const o of origins) {
      const some = trials.filter((t) => t.origin === o.key && !t.selected);
      data.push(marks(some, scale, Object.assign({name: o.label, legendgroup: o.key, showlegend: first}, on), {symbol: o.symbol, size: 10}));
    }
    data.push(marks(trials.filter((t) => t.selected), scale, Object.assign({name: "selected design", legendgroup: "selected", showlegend: first}, on), {symbol: "star", size: 20}));
    errors.push(data.length);
    data.push(Object.assign({type: "scatter", mode: "markers", x: [], y: [], showlegend: false, hoverinfo: "skip", marker: {size: 1, color: ink}, error_x: {array: [], color: ink, thickness: 1.2}, error_y: {array: [], color: ink, thickness: 1.2}}, on));
  });
  figure.show(data, layout, "Colour: width of the air gap on each side of the stem. Point at a mark for its design and the errors of both objectives.").then(() => {
    figure.plot.on("plotly_hover", (event) => {
      const t = event.points[0].customdata, panel = panels.findIndex((c, p) => event.points[0].data.xaxis === (p === 0 ? "x" : `x${p + 1}`));
      if (t) Plotly.restyle(figure.plot, {x: [[t.J_contact]], y: [[t.J_obs / scale]], "error_x.array": [[t.J_contact_err]], "error_y.array": [[t.J_obs_err / scale]]}, [errors[panel]]);
    });
    figure.plot.on("plotly_unhover", () => Plotly.restyle(figure.plot, {x: [[]], y: [[]]}, errors));
  });
}

function marks(trials, scale, rest, marker) {
  return Object.assign({type: "scatter", mode: "markers", x: trials.map((t) => t.J_contact), y: trials.map((t) => t.J_obs / scale), customdata: trials, text: trials.map(hoverText), hoverinfo: "text",
    marker: Object.assign({color: trials.map((t) => t.theta_mm[4]), coloraxis: "coloraxis", line: {color: ink, width: 0.9}}, marker)}, rest);
}

function makeHistory() {
  let campaign = null;
  const figure = new Figure(document.getElementById("history"), "history-figure", "", "hypervolume", () =>
    [["evaluation", "index", "hypervolume"], ...evaluated(campaign).map((t, k) => [k + 1, t.index, t.hypervolume])]);
  return (c) => {
    campaign = c;
    const trials = evaluated(c);
    if (trials.length === 0) return figure.say("No evaluation has succeeded yet.");
    const {scale, title} = axisScale(trials.map((t) => t.hypervolume), "hypervolume", "W/W");
    const starts = trials.filter((t) => t.origin !== "search").length, count = trials.map((t, k) => k + 1);
    const y = trials.map((t) => t.hypervolume / scale), high = 1.08 * Math.max(...y) || 1;
    const layout = {height: 340, xaxis: axis("successful evaluations", {range: [0, trials.length + 1], dtick: [1, 2, 5, 10, 20, 50, 100].find((d) => trials.length <= 12 * d)}), yaxis: axis(title, {range: [0, high]}), showlegend: false, shapes: [], annotations: []};
    if (starts < trials.length) {
      layout.shapes.push({type: "rect", xref: "x", yref: "paper", x0: 0, x1: starts + 0.5, y0: 0, y1: 1, fillcolor: "#f0f2f5", line: {width: 0}, layer: "below"});
      layout.annotations.push({text: "starts", xref: "x", yref: "paper", x: 0.5 * (starts + 0.5), y: 1, yanchor: "bottom", showarrow: false, font: {color: soft, size: 12}});
    }
    figure.show([{type: "scatter", mode: "lines+markers", x: count, y, line: {shape: "hv", color: blue, width: 2}, marker: {size: 5, color: blue}, hoverinfo: "text",
      text: trials.map((t, k) => `after ${plural(k + 1, "evaluation")} (#${t.index})<br>${shown(t.hypervolume, 4)}`)}], layout);
  };
}
