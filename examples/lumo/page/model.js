// All designs side by side, and how well the search's model knows them.

// 1 for those that no other dominates, 2 for those that only these dominate, and so on.
function ranks(trials) {
  const rank = new Map();
  for (let r = 1; rank.size < trials.length; ++r) {
    const left = trials.filter((t) => !rank.has(t));
    const beaten = (t) =>
        left.some((o) => o.J_contact >= t.J_contact && o.J_obs >= t.J_obs && (o.J_contact > t.J_contact || o.J_obs > t.J_obs));
    for (const t of left.filter((t) => !beaten(t))) rank.set(t, r);
  }
  return trials.map((t) => rank.get(t));
}

function makeParallel() {
  let campaign = null, coloured = 0;
  const figure = new Figure(document.getElementById("parallel"), "parallel-figure", "", "designs", () => {
    const trials = evaluated(campaign), rank = ranks(trials);
    return [[...trialHead(), "rank"], ...trials.map((t, k) => [...trialRow(t), rank[k]])];
  });
  const draw = () => {
    const trials = evaluated(campaign);
    if (trials.length === 0) return figure.say("No evaluation has succeeded yet.");
    const rank = ranks(trials), {scale, title} = axisScale(trials.map((t) => t.J_obs), "J_obs", "W/W");
    const values = [
      ...report.variables.map((v, i) => trials.map((t) => t.theta_mm[i])), trials.map((t) => t.J_contact),
      trials.map((t) => t.J_obs / scale)
    ];
    const labels = [...report.variables.map((v) => `${v.name} [${v.unit}]`), "J_contact [–]", title].map((l) => l.replace(" [", "<br>["));
    const dimensions = values.map((v, i) => ({label: labels[i], values: v, range: range(v, v.some((x) => x !== v[0]) ? 0.02 : 0.1)}));
    const byRank = coloured === 1;
    const line = {
      color: byRank ? rank : values[6],
      colorscale: "Viridis",
      reversescale: byRank,
      showscale: true,
      colorbar: colourBar(byRank ? "rank, 1: Pareto set" : title)
    };
    if (byRank) line.colorbar.dtick = Math.max(1, Math.ceil(Math.max(...rank) / 8));
    if (byRank && Math.max(...rank) === 1) Object.assign(line, {cmin: 1, cmax: 2});
    // The ends of an axis say nothing that its ticks do not: their labels are made invisible.
    figure
        .show(
            [{type: "parcoords", dimensions, line, labelfont: {size: 13}, tickfont: {size: 12}, rangefont: {size: 1, color: "#fff"}}],
            {height: 430, margin: {l: 60, r: 30, t: 76, b: 28}})
        .then(() => count());
  };
  const count = () => {
    const trials = evaluated(campaign), kept = new Set(trials.map((t, k) => k));
    for (const d of figure.plot.data[0].dimensions) {
      const ranges = d.constraintrange ? (Array.isArray(d.constraintrange[0]) ? d.constraintrange : [d.constraintrange]) : [];
      if (ranges.length > 0)
        d.values.forEach((v, k) => {
          if (!ranges.some(([a, b]) => v >= a && v <= b)) kept.delete(k);
        });
    }
    const some = [...kept].map((k) => trials[k]);
    figure.caption.textContent = kept.size === trials.length ?
        `${plural(trials.length, "design")}.` :
        `${kept.size} of ${plural(trials.length, "design")} within the brushes${
            kept.size > 0 && kept.size <= 12 ? ": " + some.map((t) => `#${t.index} [${thetaText(t.theta_mm)}]`).join(", ") : ""}.`;
  };
  figure.choice("coloured by", ["J_obs", "rank"], (k) => {
    coloured = k;
    draw();
  });
  let listens = false;
  return (c) => {
    campaign = c;
    draw();
    if (!listens && figure.plot.on) figure.plot.on("plotly_restyle", count), listens = true;
  };
}

function makeCheck() {
  let campaign = null;
  const checks = () => campaign.model_check.filter((m) => m !== null);
  const figure = new Figure(
      document.getElementById("check"), "check-figure", "", "model_check",
      () => [
          ["objective", "index", "computed", "predicted", "predicted_deviation"],
          ...checks().flatMap((m) => m.points.map((p) => [m.objective, p.index, p.computed, p.predicted, p.deviation]))]);
  return (c) => {
    campaign = c;
    if (checks().length < 2) return figure.say("There are fewer than five evaluations: too few to check a model.");
    const data = [], layout = {height: 440, showlegend: false};
    const captions = checks().map((m, i) => {
      const n = i === 0 ? "" : "2", unit = m.objective === "J_obs" ? "W/W" : "";
      const {scale, title} = axisScale(m.points.map((p) => p.computed), m.objective, unit);
      const low = m.points.flatMap((p) => [p.computed, p.predicted - 1.96 * p.deviation]),
            high = m.points.flatMap((p) => [p.computed, p.predicted + 1.96 * p.deviation]);
      const span = range([...low, ...high].map((v) => v / scale), 0.04);
      layout[`xaxis${n}`] = axis(
          `computed ${title}`,
          {domain: i === 0 ? [0, 0.445] : [0.555, 1], anchor: `y${n}`, range: range(m.points.map((p) => p.computed / scale), 0.08)});
      layout[`yaxis${n}`] = axis(`predicted ${title}`, {anchor: `x${n}`, range: span});
      data.push({
        type: "scatter",
        mode: "lines",
        x: span,
        y: span,
        line: {color: soft, width: 1.2, dash: "dot"},
        hoverinfo: "skip",
        xaxis: `x${n}`,
        yaxis: `y${n}`
      });
      data.push({
        type: "scatter",
        mode: "markers",
        x: m.points.map((p) => p.computed / scale),
        y: m.points.map((p) => p.predicted / scale),
        xaxis: `x${n}`,
        yaxis: `y${n}`,
        error_y: {array: m.points.map((p) => 1.96 * p.deviation / scale), color: blue, thickness: 1, width: 3},
        marker: {size: 7, color: blue, line: {color: "#fff", width: 0.8}},
        hoverinfo: "text",
        text: m.points.map(
            (p) => `#${p.index}<br>computed ${shown(p.computed, 4)}<br>predicted ${withError(p.predicted, 1.96 * p.deviation)}`)
      });
      return `${m.objective}: ${Math.round(100 * m.coverage)} % of ${m.points.length} within the bars, standardised RMS error ${
          shown(m.standardised_rms)}`;
    });
    figure.show(
        data, layout,
        `Bars: 95 % intervals; dotted: predicted = computed. ${captions.join("; ")}. A model that knows its own error has 95 % and 1.`);
  };
}
