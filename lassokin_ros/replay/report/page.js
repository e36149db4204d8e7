// Time and person, and their controls. The address may give a start: report.html#t=3.2&person=p2
const now = () => (me.time.length ? me.time[frame] : 0);
function nearest(time) {
  let best = 0;
  me.time.forEach((t, i) => { if (Math.abs(t - time) < Math.abs(me.time[best] - time)) best = i; });
  return best;
}
function showTime() {
  const refused = me.refused[frame];
  element("time").textContent = `${now().toFixed(2)} s of ${data.duration.toFixed(2)} s` + (refused ? `, rejected: ${refused}` : "");
  element("slider").value = frame;
  const absent = Number.isNaN(place[0](frame, 0));
  const doubt = absent ? undefined : me.wrong.find(([start, end]) => start <= now() && now() <= end);
  for (const note of document.querySelectorAll(".doubtful")) {
    note.hidden = !doubt;
    note.textContent = doubt ? `likely wrong: ${doubt[2]}` : "";
  }
  for (const note of document.querySelectorAll(".absent")) {
    note.hidden = !absent || !me.time.length;
    note.textContent = `no skeleton at this time${refused ? `: ${refused}` : ""}`;
  }
}
async function go(index, always = true) {
  frame = Math.max(0, Math.min(index, me.time.length - 1));
  showTime();
  if (!me.time.length || busy) return;
  busy = true;
  let drawn;
  do {                                                   // if the frame changed while drawing, draw the newest one
    drawn = frame;
    await Promise.all([moveSpace(), moveImage(), moveCursor(always)]);
  } while (drawn !== frame);
  busy = false;
  document.body.dataset.frame = String(frame);
}

function play(on) {
  playing = on && me.time.length > 1;
  element("play").innerHTML = playing ? "&#10073;&#10073; Pause" : "&#9654; Play";
  if (!playing) return void go(frame);
  if (frame >= me.time.length - 1) frame = 0;
  clock = now();
  let before = performance.now();
  const tick = (moment) => {
    if (!playing) return;
    clock += ((moment - before) / 1000) * Number(element("speed").value);
    before = moment;
    let index = frame;
    while (index < me.time.length - 1 && me.time[index + 1] <= clock) index++;
    if (index !== frame) go(index, false);
    if (index >= me.time.length - 1) return play(false);
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

let turnedAt = null;
async function turn(moment) {
  if (!element("turn").checked) { turnedAt = null; return; }
  const angle = turnedAt === null ? 0 : TURN_PER_SECOND * Math.min((moment - turnedAt) / 1000, 0.2);
  turnedAt = moment;
  const eye = element("space").layout.scene.camera.eye, c = Math.cos(angle), s = Math.sin(angle);
  await Plotly.relayout("space", { "scene.camera.eye": { x: c * eye.x - s * eye.y, y: s * eye.x + c * eye.y, z: eye.z } });
  requestAnimationFrame(turn);
}

function firstShown() {                                 // s: the first skeleton that is not marked, else the first one
  const shown = me.time.filter((_, i) => !Number.isNaN(me.positions.at(i, 0)));
  return shown.find((t) => !me.wrong.some(([start, end]) => start <= t && t <= end)) ?? shown[0] ?? 0;
}

async function choosePerson(index, time) {
  me = data.people[index];
  frame = nearest(time ?? firstShown());
  element("slider").max = Math.max(me.time.length - 1, 0);
  showMarks();
  showTime();
  await Promise.all([drawSpace(), drawImage(), drawSeries(), drawLandmarks()]);
  document.body.dataset.frame = String(frame);
}

function showMarks() {                                  // spans on the slider, whose thumb keeps half its width to both ends
  const last = Math.max(me.time.length - 1, 1), marks = [];
  const add = (kind, start, end, text) => {
    const inside = me.time.map((t, i) => (start <= t && t <= end ? i : -1)).filter((i) => i >= 0);
    if (!inside.length) return;
    const mark = document.createElement("i");
    mark.className = kind;
    mark.title = text;
    mark.style.left = `${(100 * inside[0]) / last}%`;
    mark.style.width = `max(3px, ${(100 * (inside[inside.length - 1] - inside[0])) / last}%)`;
    marks.push(mark);
  };
  me.spans.forEach(([start, end, lost]) => add(lost ? "lost" : "gap", start, end, "no skeleton"));
  me.wrong.forEach(([start, end, why]) => add("wrong", start, end, `likely wrong: ${why}`));
  element("marks").replaceChildren(...marks);
}

function fill(select, names) {
  for (const name of names) select.append(new Option(name, name));
}

async function start() {
  data.people.forEach((person, i) => element("person").append(new Option(person.name || "the person", String(i))));
  element("person-label").hidden = data.people.length < 2;
  fill(element("joint"), [...Object.keys(GROUPS).filter((g) => GROUPS[g].some((j) => data.joints.includes(j))), ...data.joints]);
  const stride = data.people.length ? data.people[0].stride : 1;
  element("thinned").textContent = stride > 1 ? `Long recording: this page contains skeletons, image points and angles of every ${stride}th frame; ` +
    "error, gap and latency are the maximum of each stretch." : "";
  const address = new URLSearchParams(location.hash.slice(1));
  const first = Math.max(0, data.people.findIndex((person) => person.name === address.get("person")));
  element("person").value = String(first);
  element("person").onchange = () => { play(false); choosePerson(Number(element("person").value), now()); };
  element("slider").oninput = () => { playing = false; element("play").innerHTML = "&#9654; Play"; go(Number(element("slider").value)); };
  element("play").onclick = () => play(!playing);
  element("joint").onchange = element("inner").onchange = drawSeries;
  element("follow").onchange = drawSpace;
  element("view").onchange = drawImage;
  element("photo").onchange = drawImage;
  data.cameras.forEach((one, i) => element("camera").append(new Option(one.name, String(i))));
  element("camera-label").hidden = data.cameras.length < 2;
  const showCamera = () => {
    camera = Number(element("camera").value);
    element("photo-label").hidden = !photosOfCamera().time.length || !imageSize();
  };
  element("camera").onchange = () => { showCamera(); drawImage(); };
  showCamera();
  element("turn").onchange = () => requestAnimationFrame(turn);
  document.addEventListener("keydown", (event) => {
    if (event.target.tagName === "SELECT" || event.target.tagName === "BUTTON") return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === " ") play(!playing);
    else if (step) go(frame + step);
    else return;
    event.preventDefault();
  });
  if (data.people.length) await choosePerson(first, address.has("t") ? Number(address.get("t")) || 0 : undefined);
  document.body.dataset.drawn = "yes";
}
start().catch(fail);
