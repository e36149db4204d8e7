// The body in 3D: x to the right, depth and height, of a level camera.
const level = (row) => (f, j) => data.level[row][0] * me.positions.at(f, j, 0) + data.level[row][1] * me.positions.at(f, j, 1) +
  data.level[row][2] * me.positions.at(f, j, 2);
const down = level(1), place = [level(0), level(2), (f, j) => -down(f, j)];

function segments(list, get) {
  const values = [];
  for (const [a, b] of list) values.push(get(a), get(b), null);
  return values.map((value) => (Number.isNaN(value) ? null : value));
}
const middleOf = (axis) => (element("follow").checked && axis < 2 ? place[axis](frame, 0) : 0);
const jointPlaces = () => {
  const middle = [0, 1, 2].map(middleOf);
  return (j) => place.map((get, axis) => get(frame, j) - middle[axis]);
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

const ground = () => (me.floor === null ? extent(2, false)[0] + 0.12 : me.floor);

function ranges() {
  const centred = element("follow").checked, found = [extent(0, centred), extent(1, centred), extent(2, false)];
  found[2] = [Math.min(ground(), found[2][0] + 0.12), found[2][1] + 0.06];
  return found;
}

function scene(sides) {
  const centred = element("follow").checked;
  const sizes = sides.map(([low, high]) => high - low), largest = Math.max(...sizes), diagonal = Math.hypot(...sizes);
  const dtick = largest > 12 ? 2 : largest > 5 ? 1 : 0.5;
  const axis = (text, range) => ({ title: { text, font: { size: 12 } }, range, autorange: false, dtick, gridcolor: "#dfe4e9",
    zeroline: false, showbackground: false, tickfont: { size: 10 }, showspikes: false, tickformat: ".1f" });
  const ratio = sizes.map((size) => (1.95 * size) / diagonal);
  const away = element("space").clientWidth < 420 ? 1.35 : 1.12;   // the titles of the axes fit
  return { xaxis: axis(centred ? "to the right of the pelvis, m" : "to the right, m", sides[0]),
    yaxis: axis(centred ? "behind the pelvis, m" : "depth, m", sides[1]), zaxis: axis("above the camera, m", sides[2]),
    aspectmode: "manual", aspectratio: { x: ratio[0], y: ratio[1], z: ratio[2] }, dragmode: "turntable",
    camera: { eye: { x: 0.8 * away, y: -2.1 * away, z: 0.4 * away }, center: { x: 0, y: 0, z: -0.12 }, up: { x: 0, y: 0, z: 1 } } };
}

function path() {                                       // path of the pelvis, drawn on the floor
  const points = me.time.map((_, f) => place.slice(0, 2).map((get) => none(get(f, 0))));
  const shown = element("follow").checked ? [] : points, floor = ground() + 0.004;
  return { type: "scatter3d", mode: "lines", x: shown.map((p) => p[0]), y: shown.map((p) => p[1]), z: shown.map(() => floor),
    hoverinfo: "skip", line: { color: "#7b8794", width: 3 }, connectgaps: false };
}

function floor([[left, right], [near, far]]) {          // it fills the axes, so it also keeps them when there is no skeleton
  const z = ground();
  return { type: "mesh3d", x: [left, right, right, left], y: [near, near, far, far], z: [z, z, z, z], i: [0, 0], j: [1, 2], k: [2, 3],
    color: "#d5dce3", opacity: 0.65, hoverinfo: "skip", lighting: { ambient: 1, diffuse: 0, specular: 0 } };
}

function drawSpace() {
  const get = jointPlaces(), places = data.joints.map((_, j) => get(j).map(none)), sides = ranges();
  const traces = bodyMeshes(get).map((mesh, n) => ({ type: "mesh3d", ...mesh, color: COLOUR[SEEN[n % 3]], opacity: n < 3 ? 1 : 0.22,
    flatshading: false, hoverinfo: "skip", lighting: LIGHT, lightposition: { x: -500, y: -2000, z: 3000 }, name: SEEN[n % 3] }));
  traces.push({ type: "scatter3d", mode: "markers", x: places.map((p) => p[0]), y: places.map((p) => p[1]), z: places.map((p) => p[2]),
    text: data.joints.map(plain),
    hovertemplate: "%{text}<br>%{x:.2f}, %{y:.2f}, %{z:.2f} m<br>uncertainty %{customdata:.0f} mm<extra></extra>",
    customdata: deviations(), marker: { size: 4, color: "#fff", opacity: 0.9, line: { color: INK, width: 1 } } });
  traces.push(path(), floor(sides));
  return Plotly.react("space", traces, { scene: scene(sides), showlegend: false, margin: { l: 0, r: 0, t: 0, b: 0 }, font: FONT,
    paper_bgcolor: "#fff", uirevision: "space" }, HOME);
}
const JOINTS_TRACE = 6;
async function moveSpace() {
  const get = jointPlaces(), places = data.joints.map((_, j) => get(j).map(none)), meshes = bodyMeshes(get), update = {};
  for (const key of ["x", "y", "z", "i", "j", "k"]) update[key] = meshes.map((mesh) => mesh[key]);
  await Plotly.restyle("space", update, meshes.map((_, n) => n));
  return Plotly.restyle("space", { x: [places.map((p) => p[0])], y: [places.map((p) => p[1])], z: [places.map((p) => p[2])],
    customdata: [deviations()] }, [JOINTS_TRACE]);
}
