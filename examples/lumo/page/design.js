// The selected design: its section, and how it gives way.

const distinct = (values) => [...new Set(values)].sort((a, b) => a - b);
const diameterColours = [blue, orange, green, purple, "#e69f00", "#56b4e9"];
const noDesign = "No design is selected yet: no evaluation has succeeded.";

function makeSection() {
  let design = null;
  const figure = new Figure(
      document.getElementById("design"), "section-figure", "Cross-section", "section",
      () => [["part", "corner", "x_mm", "z_mm"], ...design.section.areas.flatMap((a) => a.loop_mm.map((p, k) => [a.part, k, ...p]))]);
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
  const figure = new Figure(
      document.getElementById("design"), "force-figure", "Force over depth", "force_depth",
      () => [
          ["diameter_mm", "angle_deg", "y_mm", "load_N", "force_N", "depth_mm", "contact_area_mm2", "reference_area_mm2"],
          ...design.scenarios.flatMap(
              (s) => s.states.map(
                  (k) =>
                      [s.diameter_mm, s.angle_deg, s.y_mm, k.load_N, k.force_N, k.depth_mm, k.contact_area_mm2, k.reference_area_mm2]))]);
  const choice = figure.choice("place", [], (k) => {
    chosen = k;
    draw();
  });
  const draw = () => {
    const here = design.scenarios.filter((s) => place(s) === places[chosen]).sort((a, b) => a.diameter_mm - b.diameter_mm);
    const data = here.map((s, k) => ({
                            type: "scatter",
                            mode: "lines+markers",
                            name: `sphere of ${s.diameter_mm} mm`,
                            line: {color: diameterColours[k % 6], width: 2},
                            marker: {size: 8, symbol: ["circle", "square", "diamond", "triangle-up"][k % 4]},
                            x: [0, ...s.states.map((q) => q.depth_mm)],
                            y: [0, ...s.states.map((q) => q.force_N)],
                            hoverinfo: "text",
                            text: [
                              "first touch",
                              ...s.states.map(
                                  (q) => `${s.diameter_mm} mm sphere<br>${shown(q.force_N)} N at ${shown(q.depth_mm, 4)} mm<br>contact ${
                                      shown(q.contact_area_mm2)} mm²`)
                            ]
                          }));
    figure.show(
        data,
        {height: 420, xaxis: axis("depth since first touch [mm]", {rangemode: "tozero"}), yaxis: axis("force [N]", {rangemode: "tozero"})});
  };
  return (c) => {
    design = c.design;
    if (design === null || design.scenarios.length === 0)
      return figure.say(design === null ? noDesign : "The store has no record of this design's contacts.");
    places = [...new Set(design.scenarios.map(place))];
    chosen = Math.max(0, places.indexOf(place({y_mm: 0, angle_deg: 0})));
    choice.refill(places, chosen);
    draw();
  };
}
