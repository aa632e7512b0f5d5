// Of what stands in the figure: the models' deviations, or the errors that were reported.
const errorsOf = (t) => isNumber(t.deviation[0]) ? t.deviation : [t.J_contact_err, t.J_obs_err];

// One panel for each campaign; those of one material share their axes.
function drawPareto(campaigns) {
  const figure = new Figure(
      document.getElementById("pareto"), "pareto-figure", "", "pareto",
      () => [
          ["material", "ensemble", ...trialHead()],
          ...campaigns.flatMap((c) => evaluated(c).map((t) => [c.material, c.ensemble, ...trialRow(t)]))]);
  const panels = campaigns.filter((c) => evaluated(c).some((t) => t.on_front))
                     .sort((a, b) => b.ensemble.localeCompare(a.ensemble) || a.material.localeCompare(b.material));
  if (panels.length === 0) return figure.say("No evaluation has succeeded yet, so there is no Pareto set.");
  const {scale, title} = axisScale(panels.flatMap((c) => evaluated(c).map((t) => t.value[1])), "J_obs", "W/W");
  const columns = Math.min(2, panels.length), rows = Math.ceil(panels.length / columns), single = panels.length === 1;
  const data = [], errors = [], annotations = [];
  const layout = {
    height: single ? 540 : 80 + 390 * rows,
    coloraxis: {colorscale: "Viridis", cmin: report.variables[4].lower, cmax: report.variables[4].upper, colorbar: colourBar("w_v [mm]")},
    annotations
  };
  layout.legend = {orientation: "h", x: 0, y: single ? -0.14 : -0.16 / rows, xanchor: "left", yanchor: "top"};
  panels.forEach((c, p) => {
    const n = p === 0 ? "" : String(p + 1), column = p % columns, row = Math.floor(p / columns);
    const gap = single ? 0 : 0.13, width = (1 - gap * (columns - 1)) / columns, gapY = 0.27 / rows, height = (1 - gapY * (rows - 1)) / rows;
    const x0 = column * (width + gap), y1 = 1 - row * (height + gapY);
    const family = panels.filter((o) => o.material === c.material).flatMap(evaluated);
    const within = (k) => family.flatMap((t) => [t.value[k] - errorsOf(t)[k], t.value[k] + errorsOf(t)[k]]);  // no closer than the errors allow
    const xRange = range(within(0), 0.06), yRange = range(within(1).map((v) => v / scale), 0.06);
    layout[`xaxis${n}`] = axis("J_contact [–]", {domain: [x0, x0 + width], anchor: `y${n}`, range: xRange});
    layout[`yaxis${n}`] = axis(title, {domain: [y1 - height, y1], anchor: `x${n}`, range: yRange});
    if (!single)
      annotations.push({
        text: `<b>${c.name}</b>`,
        xref: "paper",
        yref: "paper",
        x: x0,
        y: y1,
        xanchor: "left",
        yanchor: "bottom",
        showarrow: false,
        font: {size: 14}
      });
    const on = {xaxis: `x${n}`, yaxis: `y${n}`}, trials = evaluated(c), first = p === 0;
    const front = trials.filter((t) => t.on_front).sort((a, b) => a.value[0] - b.value[0]);
    data.push(Object.assign(
        {
          type: "scatter",
          mode: "lines",
          name: "Pareto set",
          legendgroup: "front",
          showlegend: first,
          hoverinfo: "skip",
          line: {shape: "vh", color: soft, width: 1.6},
          x: [xRange[0], ...front.map((t) => t.value[0]), front[front.length - 1].value[0]],
          y: [front[0].value[1] / scale, ...front.map((t) => t.value[1] / scale), yRange[0]]
        },
        on));
    for (const o of origins) {
      const some = trials.filter((t) => t.origin === o.key && !t.selected);
      data.push(
          marks(some, scale, Object.assign({name: o.label, legendgroup: o.key, showlegend: first}, on), {symbol: o.symbol, size: 10}));
    }
    data.push(marks(
        trials.filter((t) => t.selected), scale, Object.assign({name: "selected design", legendgroup: "selected", showlegend: first}, on),
        {symbol: "star", size: 20}));
    errors.push(data.length);
    data.push(Object.assign(
        {
          type: "scatter",
          mode: "markers",
          x: [],
          y: [],
          showlegend: false,
          hoverinfo: "skip",
          marker: {size: 1, color: ink},
          error_x: {array: [], color: ink, thickness: 1.2},
          error_y: {array: [], color: ink, thickness: 1.2}
        },
        on));
  });
  figure
      .show(
          data, layout,
          "Colour: width of the air gap on each side of the stem. Point at a mark for its design and the errors of both objectives.")
      .then(() => {
        figure.plot.on("plotly_hover", (event) => {
          const t = event.points[0].customdata,
                panel = panels.findIndex((c, p) => event.points[0].data.xaxis === (p === 0 ? "x" : `x${p + 1}`));
          if (t)
            Plotly.restyle(
                figure.plot, {
                  x: [[t.value[0]]],
                  y: [[t.value[1] / scale]],
                  "error_x.array": [[errorsOf(t)[0]]],
                  "error_y.array": [[errorsOf(t)[1] / scale]]
                },
                [errors[panel]]);
        });
        figure.plot.on("plotly_unhover", () => Plotly.restyle(figure.plot, {x: [[]], y: [[]]}, errors));
      });
}

function marks(trials, scale, rest, marker) {
  return Object.assign(
      {
        type: "scatter",
        mode: "markers",
        x: trials.map((t) => t.value[0]),
        y: trials.map((t) => t.value[1] / scale),
        customdata: trials,
        text: trials.map(hoverText),
        hoverinfo: "text",
        marker: Object.assign({color: trials.map((t) => t.theta_mm[4]), coloraxis: "coloraxis", line: {color: ink, width: 0.9}}, marker)
      },
      rest);
}
