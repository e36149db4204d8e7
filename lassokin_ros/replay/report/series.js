// Figures over time, and by landmark.
const BASIC = 3;                                        // rows that are shown without the solver's figures
const ROWS = [["reprojection<br>error, px", 1.1], ["angle, deg", 1.6], ["joint<br>uncertainty,<br>mm", 1], ["moving<br>degrees of<br>freedom", 1],
  ["duality gap,<br>relative", 0.8], ["rate, Hz", 0.8], ["latency, ms", 0.8]];
const GROUPS = { "knees and elbows": ["left_knee", "right_knee", "left_elbow", "right_elbow"],
  "hips and shoulders": ["left_hip", "right_hip", "left_shoulder", "right_shoulder"],
  "spine, neck, head": ["spine1", "spine2", "spine3", "neck", "head"] };

function whole(time, value) {                            // lines are interrupted at gaps
  const x = [], y = [];
  let next = 0;
  const gaps = me.spans;
  time.forEach((t, i) => {
    while (next < gaps.length && gaps[next][1] <= t) {
      if (x.length && x[x.length - 1] <= gaps[next][0]) { x.push(gaps[next][0], gaps[next][1]); y.push(null, null); }
      next++;
    }
    x.push(t);
    y.push(none(value[i]));
  });
  return { x, y };
}

function angleTraces() {
  const chosen = element("joint").value, row = 2, made = [];
  const line = (name, get, colour, dash) => made.push({ type: "scatter", mode: "lines", yaxis: `y${row}`, name: plain(name),
    ...whole(me.time, me.time.map((_, f) => get(f))), line: { color: colour, width: 1.5, dash }, connectgaps: false,
    hovertemplate: "%{y:.0f} deg" });
  if (chosen in GROUPS) {
    const known = GROUPS[chosen].filter((name) => data.joints.includes(name));
    const spine = known.length && side(known[0]) === "middle";
    known.forEach((name, i) => {
      const joint = data.joints.indexOf(name);
      line(name, (f) => me.bends.at(f, joint), spine ? [...TURNS, COLOUR.middle, "#cc79a7"][i] : COLOUR[side(name)],
        !spine && i > 1 ? "dot" : "solid");
    });
  } else {
    const joint = data.joints.indexOf(chosen);
    ["x", "y", "z"].forEach((axis, i) => line(`${chosen}_${axis}`, (f) => me.angles.at(f, joint, i), TURNS[i], "solid"));
  }
  while (made.length < 5) made.push({ type: "scatter", x: [null], y: [null], yaxis: `y${row}`, showlegend: false, name: "" });
  return made;
}

function seriesTraces() {
  const line = (row, series, name, unit, style) => ({ type: "scatter", mode: "lines", yaxis: row === 1 ? "y" : `y${row}`,
    ...whole(series.time, series.value), name, showlegend: false, connectgaps: false, hovertemplate: `%{y:${unit}`,
    line: { color: COLOUR.left, width: 1.5 }, ...style });
  const gap = { time: me.series.gap.time, value: me.series.gap.value.map((v) => (v === null ? null : Math.max(v, 1e-17))) };
  const flat = ({ x, y }) => ({ x, y: y.map((v) => v ?? 0) }); // an area cannot have gaps; it is 0 there
  const rate = (name, value, style) => line(6, { time: data.rate.time, value }, name, ".1f} Hz", style);
  const rowOf = (trace) => Number((trace.yaxis || "y").slice(1)) || 1;
  return [...angleTraces(),
    line(1, me.series.reprojection, "reprojection error", ".2f} px"),
    { type: "scatter", mode: "markers", x: me.refusals.map((r) => r[0]), y: me.refusals.map(() => 0), yaxis: "y",
      text: me.refusals.map((r) => plain(r[1])), name: "rejected", showlegend: false, cliponaxis: false,
      hovertemplate: "%{text}", marker: { symbol: "line-ns", size: 9, line: { color: "#cc79a7", width: 1.5 } } },
    line(3, me.series.deviation, "mean over joints", ".0f} mm"),
    line(3, me.series.worst_deviation, "most uncertain joint", ".0f} mm", { line: { color: "#56b4e9", width: 1 } }),
    line(4, me.series.support, "move", ".0f}", { ...flat(whole(me.series.support.time, me.series.support.value)), line: { color: COLOUR.middle, width: 1 }, fill: "tozeroy",
      fillcolor: "rgba(77,77,77,.22)" }),
    line(5, gap, "duality gap", ".1e}", { mode: "lines+markers", marker: { size: 2, color: COLOUR.left }, line: { width: 0.7, color: COLOUR.left } }),
    rate("keypoints in", data.rate.in, { line: { color: "#8a949e", width: 4 } }),
    rate("messages with a skeleton", data.rate.out, {}),
    line(7, times, "latency", ".2f} ms", { line: { color: "#e69f00", width: 1 } })].filter((trace) => rowOf(trace) <= rowsShown().length);
}

const rowsShown = () => (element("inner").checked ? ROWS : ROWS.slice(0, BASIC));

function seriesLayout() {
  const rows = rowsShown(), total = rows.reduce((sum, row) => sum + row[1], 0), space = 0.022, layout = {};
  let top = 1;
  rows.forEach(([text, share], i) => {
    const height = (share / total) * (1 - space * rows.length);
    if (i === 1) top -= space;                           // space for the legend
    layout[i ? `yaxis${i + 1}` : "yaxis"] = { domain: [Math.max(top - height, 0), top], title: { text, standoff: 8, font: { size: 11 } },
      gridcolor: LINE, zeroline: false, rangemode: i === 1 ? "normal" : "tozero", nticks: 5, automargin: false,
      ...(i === 4 ? { type: "log", exponentformat: "power", rangemode: "normal", nticks: 4 } : {}) };
    top -= height + space;
  });
  const shade = me.spans.map(([start, end, lost]) => ({ type: "rect", xref: "x", yref: "paper", x0: start, x1: end, y0: 0, y1: 1,
    layer: "below", line: { width: 0 }, fillcolor: lost ? "rgba(204,121,167,.32)" : "rgba(204,121,167,.14)" }));
  const wrong = me.wrong.map(([start, end]) => ({ type: "rect", xref: "x", yref: "paper", x0: start, x1: end, y0: 0, y1: 1,
    layer: "below", line: { width: 0 }, fillcolor: "rgba(230,159,0,.28)" }));
  const cursor = { type: "line", xref: "x", yref: "paper", x0: now(), x1: now(), y0: 0, y1: 1, line: { color: CURSOR, width: 1, dash: "dot" } };
  return { ...layout, xaxis: { title: { text: "time, s" }, range: [0, Math.max(data.duration, 0.1)], anchor: `y${rows.length}`, gridcolor: LINE,
    zeroline: false, ticks: "outside", hoverformat: ".2f" }, shapes: [cursor, ...shade, ...wrong], hovermode: "x", hoverdistance: 40,
    legend: { orientation: "h", x: 1, xanchor: "right", y: layout.yaxis2.domain[1], yanchor: "bottom", font: { size: 11 }, bgcolor: "rgba(0,0,0,0)" }, font: FONT, dragmode: "zoom",
    margin: { l: 86, r: 14, t: 10, b: 42 }, height: rows.length > BASIC ? 960 : 560, paper_bgcolor: "#fff", plot_bgcolor: "#fff", uirevision: "series" };
}

async function drawSeries() {
  await Plotly.react("series", seriesTraces(), seriesLayout(), { ...QUIET, scrollZoom: false });
  const graph = element("series");
  graph.removeAllListeners("plotly_click");
  graph.on("plotly_click", (event) => { if (event.points.length) go(nearest(event.points[0].x)); });
}
async function moveCursor(always) {
  const moment = performance.now();
  if (!always && moment - cursorAt < CURSOR_EVERY) return;
  cursorAt = moment;
  await Plotly.relayout("series", { "shapes[0].x0": now(), "shapes[0].x1": now() });
}

function drawLandmarks() {
  const names = data.landmarks.map(plain), sides = data.landmarks.map(side), { error, seen } = me.landmarks;
  const margin = { l: 60, r: 46, t: 4, b: 54 }, height = 104 + 19 * L, width = (0.7 * (height - margin.t - margin.b)) / L;
  const bars = SIDES.map((s) => {                        // thick lines: this plotly.js has no bars
    const own = names.map((_, i) => i).filter((i) => sides[i] === s);
    return { type: "scatter", mode: "lines", x: own.flatMap((i) => [0, error[i], null]), y: own.flatMap((i) => [names[i], names[i], null]),
      line: { color: COLOUR[s], width }, hoverinfo: "skip" };
  });
  const labels = { type: "scatter", mode: "text", x: error, y: names, text: seen.map((share) => ` ${Math.round(share)} %`),
    textposition: "middle right", cliponaxis: false, hoverlabel: { bgcolor: sides.map((s) => COLOUR[s]) },
    hovertemplate: "%{y}: %{x:.1f} px, seen in%{text}<extra></extra>" };
  return Plotly.react("landmarks", [...bars, labels], { margin, height, showlegend: false, hovermode: "y", hoverdistance: width / 2,
    xaxis: { title: { text: "median, px<br>(label: % of frames in which it is seen)", font: { size: 12 } }, gridcolor: LINE, rangemode: "tozero" },
    yaxis: { automargin: true, dtick: 1, tickfont: { size: 11 }, showgrid: false, categoryarray: names, range: [L - 0.5, -0.5] },
    font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", dragmode: false }, { ...QUIET, scrollZoom: false });
}
