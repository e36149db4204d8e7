// The skeleton in 3D: x to the right, depth and height, as seen from the camera.
const place = [(f, j) => me.positions.at(f, j, 0), (f, j) => me.positions.at(f, j, 2), (f, j) => -me.positions.at(f, j, 1)];

function segments(list, get) {
  const values = [];
  for (const [a, b] of list) values.push(get(a), get(b), null);
  return values.map((value) => (Number.isNaN(value) ? null : value));
}
const spaceValues = (axis) => {
  const middle = element("follow").checked && axis < 2 ? place[axis](frame, 0) : 0;
  const get = (j) => place[axis](frame, j) - middle;
  return [...SIDES.map((s) => segments(bones[s], get)), data.joints.map((_, j) => get(j))];
};

const deviations = () => data.joints.map((_, j) => none(1e3 * me.deviations.at(frame, j)));

function extent(axis, centred) {
  const values = [];
  for (let f = 0; f < me.positions.count; f++) {
    const middle = centred ? place[axis](f, 0) : 0;
    for (let j = 0; j < J; j++) values.push(place[axis](f, j) - middle);
  }
  const [low, high] = usual(values, OUTLYING_M);
  return low < high ? [low - 0.12, high + 0.12] : [-1, 1];
}

function scene() {
  const centred = element("follow").checked;
  const ranges = [extent(0, centred), extent(1, centred), extent(2, false)];
  ranges[2][0] += 0.12;                                  // the floor is at the lowest foot position
  const sizes = ranges.map(([low, high]) => high - low), largest = Math.max(...sizes), diagonal = Math.hypot(...sizes);
  const axis = (text, range, floor) => ({ title: { text, font: { size: 12 } }, range, autorange: false, dtick: 0.5,
    gridcolor: "#cfd6dc", zeroline: false, showbackground: floor, backgroundcolor: "#eef1f4", tickfont: { size: 10 },
    showspikes: false, tickformat: ".1f" });
  if (largest > 5) ranges.forEach((_, i) => { ranges[i].step = largest > 12 ? 2 : 1; });
  const made = [axis(centred ? "to the right of the pelvis, m" : "to the right, m", ranges[0], false),
    axis(centred ? "behind the pelvis, m" : "depth, m", ranges[1], false), axis("above the camera, m", ranges[2], true)];
  made.forEach((one, i) => { if (ranges[i].step) one.dtick = ranges[i].step; });
  const ratio = sizes.map((size) => (1.95 * size) / diagonal);
  return { xaxis: made[0], yaxis: made[1], zaxis: made[2], aspectmode: "manual",
    aspectratio: { x: ratio[0], y: ratio[1], z: ratio[2] }, dragmode: "orbit",
    camera: { eye: { x: 0.8, y: -2.1, z: 0.4 }, center: { x: 0, y: 0, z: -0.12 }, up: { x: 0, y: 0, z: 1 } } };
}

function path() {                                       // path of the pelvis, drawn on the floor
  const floor = extent(2, false)[0] + 0.12, points = me.time.map((_, f) => place.slice(0, 2).map((get) => none(get(f, 0))));
  const shown = element("follow").checked ? [] : points;
  return { type: "scatter3d", mode: "lines", x: shown.map((p) => p[0]), y: shown.map((p) => p[1]), z: shown.map(() => floor),
    hoverinfo: "skip", line: { color: "#9aa4ae", width: 2 }, connectgaps: false };
}

function drawSpace() {
  const [x, y, z] = [0, 1, 2].map(spaceValues);
  const colours = data.joints.map((name) => COLOUR[side(name)]);
  const traces = SIDES.map((s, i) => ({ type: "scatter3d", mode: "lines", x: x[i], y: y[i], z: z[i], hoverinfo: "skip",
    line: { color: COLOUR[s], width: 9 }, name: s }));
  traces.push({ type: "scatter3d", mode: "markers", x: x[3], y: y[3], z: z[3], text: data.joints.map(plain),
    hovertemplate: "%{text}<br>%{x:.2f}, %{y:.2f}, %{z:.2f} m<br>uncertainty %{customdata:.0f} mm<extra></extra>",
    customdata: deviations(), marker: { size: data.joints.map((name) => (name === "head" ? 14 : 6)), color: colours, opacity: 1, line: { width: 0 } } });
  traces.push(path());
  if (element("follow").checked) traces.push({ type: "scatter3d", mode: "markers", x: [0], y: [0], z: [extent(2, false)[0] + 0.12],
    hoverinfo: "skip", marker: { size: 3, color: "#9aa4ae" } }); // keeps the axes when there is no skeleton
  return Plotly.react("space", traces, { scene: scene(), showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, font: FONT,
    paper_bgcolor: "#fff", uirevision: "space" }, HOME);
}
const moveSpace = () => {
  const [x, y, z] = [0, 1, 2].map(spaceValues);
  return Plotly.restyle("space", { x, y, z, customdata: [null, null, null, deviations()] }, [0, 1, 2, 3]);
};
