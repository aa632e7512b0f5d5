// The pressed pad in three dimensions.

const triples = (list) => [0, 1, 2].map((i) => list.filter((v, k) => k % 3 === i));

// Lower half of a sphere. It is drawn a little smaller than it is, or the pad would shine through where both are at one place.
function bowl(radius, z) {
  const rings = 24, sectors = 72, x = [0], y = [0], h = [z - radius], i = [], j = [], k = [];
  for (let r = 1; r <= rings; ++r)
    for (let s = 0; s < sectors; ++s) {
      const polar = 0.5 * Math.PI * r / rings, around = 2 * Math.PI * s / sectors;
      x.push(radius * Math.sin(polar) * Math.cos(around)), y.push(radius * Math.sin(polar) * Math.sin(around)),
          h.push(z - radius * Math.cos(polar));
    }
  const node = (r, s) => r === 0 ? 0 : 1 + (r - 1) * sectors + s % sectors;
  for (let r = 0; r < rings; ++r)
    for (let s = 0; s < sectors; ++s) {
      i.push(node(r, s)), j.push(node(r + 1, s)), k.push(node(r + 1, s + 1));
      if (r > 0) i.push(node(r, s)), j.push(node(r + 1, s + 1)), k.push(node(r, s + 1));
    }
  return {type: "mesh3d", x, y, z: h, i, j, k, color: "#7f868e", opacity: 0.28, hoverinfo: "skip", showscale: false, flatshading: false};
}

function makePad() {
  let design = null, presses = [], chosen = {press: 0, state: 0, colour: 0};
  const surface = () => {
    const p = presses[chosen.press], s = p.states[chosen.state], moved = s.displacement_um;
    const lengths = (list, unit) => triples(list)[0].map((v, k) => Math.hypot(...list.slice(3 * k, 3 * k + 3)) / unit);
    const length = lengths(moved, 1000), traction = lengths(s.traction_kPa, 1);
    return {p, s, traction, rest: triples(p.rest_um.map((v) => v / 1000)), now: triples(p.rest_um.map((v, k) => (v + moved[k]) / 1000)), length};
  };
  const figure = new Figure(document.getElementById("design"), "pad-figure", "The pressed pad", "pressed_pad", () => {
    const {rest, now, s} = surface();
    return [
      [
        "node", "x_mm", "y_mm", "z_mm", "rest_x_mm", "rest_y_mm", "rest_z_mm", "traction_x_kPa", "traction_y_kPa", "traction_z_kPa"
      ],
      ...now[0].map((x, n) => [n, x, now[1][n], now[2][n], rest[0][n], rest[1][n], rest[2][n], ...s.traction_kPa.slice(3 * n, 3 * n + 3)])
    ];
  });
  const sphere = figure.choice("sphere", [], (k) => {
    chosen.press = k, chosen.state = Math.min(chosen.state, presses[k].states.length - 1), loads(), draw();
  });
  const load = figure.choice("load", [], (k) => {
    chosen.state = k;
    draw();
  });
  figure.choice("colour", ["displacement", "traction"], (k) => {
    chosen.colour = k;
    draw();
  });
  const loads = () => load.refill(presses[chosen.press].states.map((s) => `${s.load_N} N`), chosen.state);
  const draw = () => {
    const {p, s, now, length, traction} = surface(), [i, j, k] = triples(p.triangles), byTraction = chosen.colour === 1;
    const data = [
      {
        type: "mesh3d",
        x: now[0],
        y: now[1],
        z: now[2],
        i,
        j,
        k,
        intensity: byTraction ? traction : length,
        colorscale: byTraction ? "Cividis" : "Viridis",
        cmin: 0,
        flatshading: false,
        cmax: Math.max(...(byTraction ? traction : length)) || 1,
        lighting: {ambient: 0.7, diffuse: 0.7, specular: 0.15, roughness: 0.7},
        lightposition: {x: 2000, y: -3000, z: 6000},
        colorbar: colourBar(byTraction ? "traction [kPa]" : "displacement [mm]", {len: 0.8}),
        hovertemplate: `x %{x:.2f} mm<br>y %{y:.2f} mm<br>z %{z:.2f} mm<br>%{intensity:.3g} ${byTraction ? "kPa" : "mm"}<extra></extra>`
      },
      bowl(0.497 * p.diameter_mm, s.sphere_z_mm)
    ];
    const away = Math.max(1, 1050 / figure.box.clientWidth);  // the whole pad also fits a narrow page
    const room = (title) =>
        ({title: {text: title}, backgroundcolor: "#fff", gridcolor: faint, showbackground: false, zeroline: false, tickfont: {size: 11}});
    figure.show(
        data, {
          height: 560,
          margin: {l: 0, r: 0, t: 8, b: 8},
          uirevision: "kept",
          scene: {
            aspectmode: "data",
            uirevision: "kept",
            camera: {eye: {x: 1.65 * away, y: -0.75 * away, z: 1.1 * away}, center: {x: 0, y: 0, z: -0.2}},
            xaxis: room("x [mm]"),
            yaxis: room("y [mm]"),
            zaxis: Object.assign(room("z [mm]"), {tickvals: [5, 10, 15, 20, 25, 30]})
          }
        },
        `${s.load_N} N on a sphere of ${p.diameter_mm} mm: ${
            shown(s.depth_mm, 4)} mm deep; its tractions, per deformed area, sum to ${s.traction_sum_N.toFixed(5)} N. Drag to turn, scroll to come nearer; the lower half of the sphere is drawn. ${
            plural(i.length, "triangle")} of the pad's surface, true to scale.`);
  };
  return (c) => {
    design = c.design;
    presses = design === null ? [] : design.presses.filter((p) => p.states.length > 0);
    if (presses.length === 0)
      return figure.say(design === null ? noDesign : `The pad was not pressed for this page: ${design.presses[0].note}`);
    chosen.press = 0, chosen.state = presses[0].states.length - 1;
    sphere.refill(presses.map((p) => `${p.diameter_mm} mm`));
    loads();
    draw();
  };
}
