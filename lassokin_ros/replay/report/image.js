// The image plane: detected keypoints and the skeleton projected through the lens.
function imageValues(axis) {
  const detected = [], reprojected = [], between = [];
  for (let l = 0; l < L; l++) {
    const point = none(inCamera().detected.at(frame, l, axis)), back = none(inCamera().reprojected.at(frame, l, axis));
    detected.push(point);
    reprojected.push(back);
    between.push(...(point === null || back === null ? [null, null, null] : [point, back, null]));
  }
  return [...SIDES.map((s) => segments(bones[s], (j) => inCamera().outline.at(frame, j, axis))), between, detected, reprojected];
}

function box(frames) {
  const values = [[], []];
  for (const f of frames) {
    for (const [points, count] of [[inCamera().detected, L], [inCamera().outline, J]]) {
      for (let i = 0; i < count; i++) for (const axis of [0, 1]) values[axis].push(points.at(f, i, axis));
    }
  }
  return values.map((all) => usual(all, OUTLYING_PX));
}

function imageRanges() {
  const view = element("view").value, every = me.time.map((_, f) => f);
  let sides = view === "image" && imageSize() ? [[0, imageSize()[0]], [0, imageSize()[1]]] : box(view === "person" ? [frame] : every);
  if (!(sides[0][0] <= sides[0][1] && sides[1][0] <= sides[1][1])) sides = box(every);
  if (!(sides[0][0] <= sides[0][1] && sides[1][0] <= sides[1][1])) sides = [[0, 1280], [0, 720]];
  const pad = 0.04 * Math.max(sides[0][1] - sides[0][0], sides[1][1] - sides[1][0]) + 5;
  return [[sides[0][0] - pad, sides[0][1] + pad], [sides[1][1] + pad, sides[1][0] - pad]];
}

// The video's image of the current frame; of a thinned recording the nearest one.
function nearestPhoto() {
  let best = 0;
  photosOfCamera().time.forEach((t, i) => { if (Math.abs(t - now()) < Math.abs(photosOfCamera().time[best] - now())) best = i; });
  return best;
}

function photoSource() {
  const shown = photosOfCamera().time.length > 0 && imageSize() && element("photo").checked, index = shown ? nearestPhoto() : 0;
  const apart = shown ? photosOfCamera().time[index] - now() : 0;
  element("photo-time").textContent = Math.abs(apart) < SAME_TIME ? "" :
    `The image is ${Math.abs(apart).toFixed(2)} s ${apart < 0 ? "older" : "newer"} than the skeleton.`;
  return shown ? `data:image/jpeg;base64,${photosOfCamera().jpeg[index]}` : "";
}

function photoLayer() {
  const source = photoSource();
  return source ? [{ source, xref: "x", yref: "y", x: 0, y: 0, sizex: imageSize()[0], sizey: imageSize()[1], sizing: "stretch",
    layer: "below", opacity: PHOTO_OPACITY }] : [];
}

function drawImage() {
  const x = imageValues(0), y = imageValues(1), [across, down] = imageRanges();
  const names = data.landmarks.map(plain);
  const traces = SIDES.map((s, i) => ({ type: "scatter", mode: "lines", x: x[i], y: y[i], hoverinfo: "skip",
    line: { color: COLOUR[s], width: 2.5 } }));
  traces.push({ type: "scatter", mode: "lines", x: x[3], y: y[3], hoverinfo: "skip", line: { color: "#777", width: 1 } });
  traces.push({ type: "scatter", mode: "markers", x: x[4], y: y[4], text: names,
    hovertemplate: "%{text}, detected<br>%{x:.1f}, %{y:.1f} px<extra></extra>",
    marker: { color: DETECTED, size: 9, line: { color: "#fff", width: 1 } } });
  traces.push({ type: "scatter", mode: "markers", x: x[5], y: y[5], text: names,
    hovertemplate: "%{text}, reprojected<br>%{x:.1f}, %{y:.1f} px<extra></extra>",
    marker: { color: REPROJECTED, size: 7, symbol: "x-thin", line: { color: REPROJECTED, width: 1.6 } } });
  const images = photoLayer();
  const axis = { showgrid: !images.length, gridcolor: LINE, zeroline: false, ticks: "outside", tickcolor: "#aab3bc" };
  const shapes = imageSize() ? [{ type: "rect", x0: 0, y0: 0, x1: imageSize()[0], y1: imageSize()[1], layer: "below",
    line: { color: "#8a949e", width: 1.5 }, fillcolor: "#fbfcfd" }] : [];
  return Plotly.react("image", traces, { xaxis: { ...axis, range: across, constrain: "domain", side: "top" },
    yaxis: { ...axis, range: down, scaleanchor: "x", constrain: "domain" }, shapes, images, showlegend: false, font: FONT,
    margin: { l: 42, r: 12, t: 26, b: 12 }, hovermode: "closest", dragmode: "pan", plot_bgcolor: "#f0f2f4",
    paper_bgcolor: "#fff" }, QUIET);
}
function moveImage() {
  const update = { x: imageValues(0), y: imageValues(1) }, layout = {};
  const source = photoSource();
  if (source) layout["images[0].source"] = source;
  if (element("view").value === "person") [layout["xaxis.range"], layout["yaxis.range"]] = imageRanges();
  return Plotly.update("image", update, layout, [0, 1, 2, 3, 4, 5]);
}
