// Where the sphere touches the pad.

const loadColours = (n) => Array.from({length: n}, (_, k) => {
  const t = n > 1 ? k / (n - 1) : 1, mix = (a, b) => Math.round(a + t * (b - a));
  return `rgb(${mix(0xa9, 0x08)},${mix(0xcf, 0x2c)},${mix(0xea, 0x5c)})`;
});

// Contact sets at the loads, largest first, so that the smaller ones lie on it; seen from outside, the finger to the right.
function makePatches() {
  let presses = [];
  const figure = new Figure(
      document.getElementById("design"), "patch-figure", "Contact patches", "contact_patches",
      () => [
          ["diameter_mm", "load_N", "contact_area_mm2", "reference_area_mm2", "loop", "y_mm", "x_mm"],
          ...presses.flatMap(
              (p) => p.states.flatMap(
                  (s) => s.outlines_mm.flatMap(
                      (loop, n) => loop.map((q) => [p.diameter_mm, s.load_N, s.contact_area_mm2, s.reference_area_mm2, n, ...q]))))]);
  return (c) => {
    presses = c.design === null ? [] : c.design.presses.filter((p) => p.states.length > 0);
    if (presses.length === 0)
      return figure.say(c.design === null ? noDesign : `The pad was not pressed for this page: ${c.design.presses[0].note}`);
    const half = report.pad.width_mm / 2, data = [], annotations = [],
          layout = {height: Math.min(540, 190 + 0.4 * figure.box.clientWidth), annotations, shapes: []}, shownLoads = new Set();
    presses.forEach((p, i) => {
      const n = i === 0 ? "" : "2", colours = loadColours(p.states.length);
      layout[`xaxis${n}`] = axis("along the finger y [mm]", {
        domain: presses.length === 1 ? [0.25, 0.75] :
            i === 0                  ? [0, 0.44] :
                                       [0.56, 1],
        anchor: `y${n}`,
        range: [-half - 1, half + 1],
        constrain: "domain",
        dtick: 5
      });
      layout[`yaxis${n}`] =
          axis("across x [mm]", {anchor: `x${n}`, scaleanchor: `x${n}`, range: [-half - 1, half + 1], constrain: "domain", dtick: 5});
      for (const side of [-half, half])
        layout.shapes.push({
          type: "line",
          xref: `x${n}`,
          yref: `y${n}`,
          x0: -half - 1,
          x1: half + 1,
          y0: side,
          y1: side,
          line: {color: soft, width: 1.2, dash: "dash"}
        });
      annotations.push({
        text: `<b>sphere of ${p.diameter_mm} mm</b>`,
        xref: `x${n} domain`,
        yref: `y${n} domain`,
        x: 0,
        y: 1,
        xanchor: "left",
        yanchor: "bottom",
        showarrow: false
      });
      p.states.map((s, k) => ({s, k})).reverse().forEach(({s, k}) => {
        const points = s.outlines_mm.flatMap((loop) => [...loop, [null, null]]);
        data.push({
          type: "scatter",
          mode: "lines",
          fill: "toself",
          x: points.map((q) => q[0]),
          y: points.map((q) => q[1]),
          xaxis: `x${n}`,
          yaxis: `y${n}`,
          fillcolor: colours[k],
          line: {color: "#fff", width: 1},
          name: `${s.load_N} N`,
          legendgroup: String(s.load_N),
          legendrank: k,
          showlegend: !shownLoads.has(s.load_N),
          hoveron: "fills",
          hoverinfo: "text",
          text: `${s.load_N} N: contact ${shown(s.contact_area_mm2)} mm²`
        });
        shownLoads.add(s.load_N);
      });
    });
    const notes = c.design.presses.filter((p) => p.note !== "").map((p) => ` Sphere of ${p.diameter_mm} mm: ${p.note}.`).join("");
    const areas =
        presses.map((p) => `${p.diameter_mm} mm: ${p.states.map((s) => `${shown(s.contact_area_mm2)} mm² at ${s.load_N} N`).join(", ")}`)
            .join("; ");
    figure.show(
        data, layout, `Pressed along z at y = 0, drawn on the undeformed pad, whose sides are dashed. Deformed areas – ${areas}.${notes}`);
  };
}
