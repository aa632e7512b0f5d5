// The selected design: its section, how it is pressed, what is seen of that.

const distinct = (values) => [...new Set(values)].sort((a, b) => a - b);
const diameterColours = [blue, orange, green, purple, "#e69f00", "#56b4e9"];
// From the darkest blue over white to the darkest red: ColorBrewer's RdBu (Harrower & Brewer 2003), which all colour visions tell apart.
const diverging = ["#053061", "#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582", "#d6604d", "#b2182b", "#67001f"].map((c, k) => [k / 10, c]);
const noDesign = "No design is selected yet: no evaluation has succeeded.";

function makeSection() {
  let design = null;
  const figure = new Figure(document.getElementById("design"), "section-figure", "Cross-section", "section", () =>
    [["part", "corner", "x_mm", "z_mm"], ...design.section.areas.flatMap((a) => a.loop_mm.map((p, k) => [a.part, k, ...p]))]);
  figure.plot.classList.add("drawing");
  return (c) => {
    design = c.design;
    if (design === null) return figure.say(noDesign);
    figure.reveal();
    figure.plot.innerHTML = design.section.svg;
  };
}

function makeForceDepth() {
  let design = null, places = [], chosen = 0;
  const figure = new Figure(document.getElementById("design"), "force-figure", "Force over depth", "force_depth", () =>
    [["diameter_mm", "angle_deg", "y_mm", "load_N", "force_N", "depth_mm", "contact_area_mm2", "reference_area_mm2"],
      ...design.scenarios.flatMap((s) => s.states.map((k) => [s.diameter_mm, s.angle_deg, s.y_mm, k.load_N, k.force_N, k.depth_mm, k.contact_area_mm2, k.reference_area_mm2]))]);
  const choice = figure.choice("place", [], (k) => { chosen = k; draw(); });
  const draw = () => {
    const here = design.scenarios.filter((s) => place(s) === places[chosen]).sort((a, b) => a.diameter_mm - b.diameter_mm);
    const data = here.map((s, k) => ({type: "scatter", mode: "lines+markers", name: `sphere of ${s.diameter_mm} mm`, line: {color: diameterColours[k % 6], width: 2},
      marker: {size: 8, symbol: ["circle", "square", "diamond", "triangle-up"][k % 4]}, x: [0, ...s.states.map((q) => q.depth_mm)], y: [0, ...s.states.map((q) => q.force_N)], hoverinfo: "text",
      text: ["first touch", ...s.states.map((q) => `${s.diameter_mm} mm sphere<br>${shown(q.force_N)} N at ${shown(q.depth_mm, 4)} mm<br>contact ${shown(q.contact_area_mm2)} mm²`)]}));
    figure.show(data, {height: 420, xaxis: axis("depth since first touch [mm]", {rangemode: "tozero"}), yaxis: axis("force [N]", {rangemode: "tozero"})});
  };
  return (c) => {
    design = c.design;
    if (design === null || design.scenarios.length === 0) return figure.say(design === null ? noDesign : "The store has no record of this design's contacts.");
    places = [...new Set(design.scenarios.map(place))];
    chosen = Math.max(0, places.indexOf(place({y_mm: 0, angle_deg: 0})));
    choice.refill(places, chosen);
    draw();
  };
}

const loadColours = (n) => Array.from({length: n}, (_, k) => { const t = n > 1 ? k / (n - 1) : 1, mix = (a, b) => Math.round(a + t * (b - a)); return `rgb(${mix(0xa9, 0x08)},${mix(0xcf, 0x2c)},${mix(0xea, 0x5c)})`; });

// Contact sets at the loads, largest first, so that the smaller ones lie on it; seen from outside, the finger to the right.
function makePatches() {
  let presses = [];
  const figure = new Figure(document.getElementById("design"), "patch-figure", "Contact patches", "contact_patches", () =>
    [["diameter_mm", "load_N", "contact_area_mm2", "reference_area_mm2", "loop", "y_mm", "x_mm"],
      ...presses.flatMap((p) => p.states.flatMap((s) => s.outlines_mm.flatMap((loop, n) => loop.map((q) => [p.diameter_mm, s.load_N, s.contact_area_mm2, s.reference_area_mm2, n, ...q]))))]);
  return (c) => {
    presses = c.design === null ? [] : c.design.presses.filter((p) => p.states.length > 0);
    if (presses.length === 0) return figure.say(c.design === null ? noDesign : `The pad was not pressed for this page: ${c.design.presses[0].note}`);
    const half = report.pad.width_mm / 2, data = [], annotations = [], layout = {height: Math.min(540, 190 + 0.4 * figure.box.clientWidth), annotations, shapes: []}, shownLoads = new Set();
    presses.forEach((p, i) => {
      const n = i === 0 ? "" : "2", colours = loadColours(p.states.length);
      layout[`xaxis${n}`] = axis("along the finger y [mm]", {domain: presses.length === 1 ? [0.25, 0.75] : i === 0 ? [0, 0.44] : [0.56, 1], anchor: `y${n}`, range: [-half - 1, half + 1], constrain: "domain", dtick: 5});
      layout[`yaxis${n}`] = axis("across x [mm]", {anchor: `x${n}`, scaleanchor: `x${n}`, range: [-half - 1, half + 1], constrain: "domain", dtick: 5});
      for (const side of [-half, half]) layout.shapes.push({type: "line", xref: `x${n}`, yref: `y${n}`, x0: -half - 1, x1: half + 1, y0: side, y1: side, line: {color: soft, width: 1.2, dash: "dash"}});
      annotations.push({text: `<b>sphere of ${p.diameter_mm} mm</b>`, xref: `x${n} domain`, yref: `y${n} domain`, x: 0, y: 1, xanchor: "left", yanchor: "bottom", showarrow: false});
      p.states.map((s, k) => ({s, k})).reverse().forEach(({s, k}) => {
        const points = s.outlines_mm.flatMap((loop) => [...loop, [null, null]]);
        data.push({type: "scatter", mode: "lines", fill: "toself", x: points.map((q) => q[0]), y: points.map((q) => q[1]), xaxis: `x${n}`, yaxis: `y${n}`, fillcolor: colours[k], line: {color: "#fff", width: 1},
          name: `${s.load_N} N`, legendgroup: String(s.load_N), legendrank: k, showlegend: !shownLoads.has(s.load_N), hoveron: "fills", hoverinfo: "text", text: `${s.load_N} N: contact ${shown(s.contact_area_mm2)} mm²`});
        shownLoads.add(s.load_N);
      });
    });
    const notes = c.design.presses.filter((p) => p.note !== "").map((p) => ` Sphere of ${p.diameter_mm} mm: ${p.note}.`).join("");
    const areas = presses.map((p) => `${p.diameter_mm} mm: ${p.states.map((s) => `${shown(s.contact_area_mm2)} mm² at ${s.load_N} N`).join(", ")}`).join("; ");
    figure.show(data, layout, `Pressed along z at y = 0, drawn on the undeformed pad, whose sides are dashed. Deformed areas – ${areas}.${notes}`);
  };
}

// Change of each readout bin's response, for each place that is touched.
function makeHeat() {
  let design = null, diameters = [], loads = [], angles = [], chosen = {d: 0, f: 0, a: 0};
  const loadsOf = (s) => s.states.map((k) => k.load_N);
  const change = (k) => k.response === null || design.unloaded_response === null ? null : k.response.map((r, b) => r - design.unloaded_response[b]);
  const figure = new Figure(document.getElementById("design"), "heat-figure", "Response", "response", () =>
    [["diameter_mm", "angle_deg", "y_mm", "load_N", "bin", "bin_y_mm", "response_W_per_W", "change_W_per_W"],
      ...design.scenarios.flatMap((s) => s.states.filter(change).flatMap((k) => change(k).map((v, b) => [s.diameter_mm, s.angle_deg, s.y_mm, k.load_N, b + 1, binPlace(b), k.response[b], v])))]);
  const binPlace = (b) => 5 * (b - (design.unloaded_response.length - 1) / 2);
  const draw = () => {
    const rows = design.scenarios.filter((s) => s.diameter_mm === diameters[chosen.d] && s.angle_deg === angles[chosen.a]).sort((a, b) => a.y_mm - b.y_mm)
      .map((s) => ({y: s.y_mm, change: s.states.filter((k) => k.load_N === loads[chosen.f]).map(change)[0]})).filter((r) => r.change);
    if (rows.length === 0) return figure.say("The store has no light of this contact.", true);
    const {scale, title} = axisScale(rows.flatMap((r) => r.change), "change of response", "W/W"), z = rows.map((r) => r.change.map((v) => v / scale));
    const top = Math.max(...z.flat().map(Math.abs)), bins = z[0].map((v, b) => minus(binPlace(b)));
    const text = rows.map((r) => r.change.map((v, b) => `touched at y = ${minus(r.y)} mm<br>bin ${b + 1}, y = ${bins[b]} mm<br>${shown(v)} W/W`));
    figure.show([{type: "heatmap", x: bins, y: rows.map((r) => minus(r.y)), z, text, hoverinfo: "text", colorscale: diverging, zmin: -top, zmax: top, xgap: 1, ygap: 1, colorbar: {title: {text: title, side: "right"}, thickness: 14, outlinewidth: 0}}],
      {height: 420, xaxis: axis("readout bin, its middle y [mm]", {type: "category", ticks: "", showgrid: false}), yaxis: axis("place of contact y [mm]", {type: "category", ticks: "", showgrid: false})},
      "Power that leaves each 5 mm bin of the visible sides, less that of the unloaded pad, per emitted power. Blue: less light; red: more.");
  };
  const diameter = figure.choice("sphere", [], (k) => { chosen.d = k; draw(); }), load = figure.choice("load", [], (k) => { chosen.f = k; draw(); }), angle = figure.choice("approach", [], (k) => { chosen.a = k; draw(); });
  return (c) => {
    design = c.design;
    if (design === null || design.scenarios.length === 0) return figure.say(design === null ? noDesign : "The store has no record of this design's contacts.");
    diameters = distinct(design.scenarios.map((s) => s.diameter_mm)), angles = distinct(design.scenarios.map((s) => s.angle_deg)), loads = distinct(design.scenarios.flatMap(loadsOf));
    chosen = {d: 0, f: loads.length - 1, a: Math.max(0, angles.indexOf(0))};
    diameter.refill(diameters.map((d) => `${d} mm`));
    load.refill(loads.map((f) => `${f} N`), chosen.f);
    angle.refill(angles.map((a) => `${minus(a)}°`), chosen.a);
    angle.box.hidden = angles.length < 2;
    draw();
  };
}
