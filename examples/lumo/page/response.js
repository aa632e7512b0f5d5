// From the darkest blue over white to the darkest red: ColorBrewer's RdBu (Harrower & Brewer 2003), which all colour visions tell apart.
const diverging = [
  "#053061", "#2166ac", "#4393c3", "#92c5de", "#d1e5f0", "#f7f7f7", "#fddbc7", "#f4a582", "#d6604d", "#b2182b", "#67001f"
].map((c, k) => [k / 10, c]);

// Change of each readout bin's response, for each place that is touched.
function makeHeat() {
  let design = null, diameters = [], loads = [], angles = [], chosen = {d: 0, f: 0, a: 0};
  const loadsOf = (s) => s.states.map((k) => k.load_N);
  const change = (k) =>
      k.response === null || design.unloaded_response === null ? null : k.response.map((r, b) => r - design.unloaded_response[b]);
  const figure = new Figure(
      document.getElementById("design"), "heat-figure", "Response", "response",
      () => [
          ["diameter_mm", "angle_deg", "y_mm", "load_N", "bin", "bin_y_mm", "response_W_per_W", "change_W_per_W"],
          ...design.scenarios.flatMap(
              (s) => s.states.filter(change).flatMap(
                  (k) => change(k).map((v, b) => [s.diameter_mm, s.angle_deg, s.y_mm, k.load_N, b + 1, binPlace(b), k.response[b], v])))]);
  const binPlace = (b) => 5 * (b - (design.unloaded_response.length - 1) / 2);
  const draw = () => {
    const rows = design.scenarios.filter((s) => s.diameter_mm === diameters[chosen.d] && s.angle_deg === angles[chosen.a])
                     .sort((a, b) => a.y_mm - b.y_mm)
                     .map((s) => ({y: s.y_mm, change: s.states.filter((k) => k.load_N === loads[chosen.f]).map(change)[0]}))
                     .filter((r) => r.change);
    if (rows.length === 0) return figure.say("The store has no light of this contact.", true);
    const {scale, title} = axisScale(rows.flatMap((r) => r.change), "change of response", "W/W"),
                  z = rows.map((r) => r.change.map((v) => v / scale));
    const top = Math.max(...z.flat().map(Math.abs)), bins = z[0].map((v, b) => minus(binPlace(b)));
    const text =
        rows.map((r) => r.change.map((v, b) => `touched at y = ${minus(r.y)} mm<br>bin ${b + 1}, y = ${bins[b]} mm<br>${shown(v)} W/W`));
    figure.show(
        [{
          type: "heatmap",
          x: bins,
          y: rows.map((r) => minus(r.y)),
          z,
          text,
          hoverinfo: "text",
          colorscale: diverging,
          zmin: -top,
          zmax: top,
          xgap: 1,
          ygap: 1,
          colorbar: colourBar(title)
        }],
        {
          height: 420,
          xaxis: axis("readout bin, its middle y [mm]", {type: "category", ticks: "", showgrid: false}),
          yaxis: axis("place of contact y [mm]", {type: "category", ticks: "", showgrid: false})
        },
        "Power that leaves each 5 mm bin of the visible sides, less that of the unloaded pad, per emitted power. Blue: less light; red: more.");
  };
  const diameter = figure.choice("sphere", [], (k) => {
    chosen.d = k;
    draw();
  }), load = figure.choice("load", [], (k) => {
    chosen.f = k;
    draw();
  }), angle = figure.choice("approach", [], (k) => {
    chosen.a = k;
    draw();
  });
  return (c) => {
    design = c.design;
    if (design === null || design.scenarios.length === 0)
      return figure.say(design === null ? noDesign : "The store has no record of this design's contacts.");
    diameters = distinct(design.scenarios.map((s) => s.diameter_mm)), angles = distinct(design.scenarios.map((s) => s.angle_deg)),
    loads = distinct(design.scenarios.flatMap(loadsOf));
    chosen = {d: 0, f: loads.length - 1, a: Math.max(0, angles.indexOf(0))};
    diameter.refill(diameters.map((d) => `${d} mm`));
    load.refill(loads.map((f) => `${f} N`), chosen.f);
    angle.refill(angles.map((a) => `${minus(a)}°`), chosen.a);
    angle.box.hidden = angles.length < 2;
    draw();
  };
}
