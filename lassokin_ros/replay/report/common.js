// Data, colours and helpers of the page. page.py concatenates all scripts into one function.
const element = (id) => document.getElementById(id);
const read = (id) => JSON.parse(element(id).textContent);
const data = read("data"), times = read("times"), photos = read("images");
const SIDES = ["left", "right", "middle"];
const COLOUR = { left: "#0072b2", right: "#d55e00", middle: "#4d4d4d" };
const DETECTED = "#009e73", REPROJECTED = "#22262b", INK = "#22262b", LINE = "#e3e7eb", CURSOR = "#22262b";
const TURNS = ["#e69f00", "#56b4e9", "#009e73"];
const FONT = { family: "system-ui, 'Segoe UI', Roboto, Arial, 'Liberation Sans', sans-serif", size: 12, color: INK };
const QUIET = { scrollZoom: true, displaylogo: false, responsive: true, displayModeBar: false };
const HOME = { ...QUIET, displayModeBar: true, modeBarButtons: [["resetCameraDefault3d"]] };
const TURN_PER_SECOND = 0.5;                             // rad
const OUTLYING_M = 1, OUTLYING_PX = 100;                // a few outlier frames must not shrink the view
const WRONG = "#e69f00";
const SAME_TIME = 0.002, PHOTO_OPACITY = 0.8;            // s; paler than the lines on it
const CURSOR_EVERY = 80;                                 // ms: moving the cursor line in all plots is slower than moving the skeleton

function fail(error) {
  const item = document.createElement("li");
  item.className = "error";
  item.textContent = `This page could not be drawn: ${error && error.message ? error.message : error}`;
  element("findings").prepend(item);
  document.body.dataset.error = item.textContent;
}
window.addEventListener("error", (event) => fail(event.error || event.message));
window.addEventListener("unhandledrejection", (event) => fail(event.reason));

const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
const side = (name) => (name.startsWith("left") ? "left" : name.startsWith("right") ? "right" : "middle");

function usual(values, outlying) {                       // minimum and maximum; the 1st and 99th percentile if the extremes are outliers
  const sorted = Float64Array.from(values.filter((value) => !Number.isNaN(value))).sort(), last = sorted.length - 1;
  if (last < 0) return [Infinity, -Infinity];
  const low = sorted[Math.floor(0.01 * last)], high = sorted[Math.ceil(0.99 * last)];
  return [sorted[0] < low - outlying ? low : sorted[0], sorted[last] > high + outlying ? high : sorted[last]];
}

const none = (value) => (Number.isNaN(value) ? null : value);

function unpack(packed) {
  const bytes = atob(packed.data), values = new Float64Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) {             // 16 bits with a sign, the low byte first
    const count = ((bytes.charCodeAt(2 * i) << 16) | (bytes.charCodeAt(2 * i + 1) << 24)) >> 16;
    values[i] = count === -32768 ? NaN : count * packed.step;
  }
  const width = packed.shape.length > 2 ? packed.shape[2] : 1, rows = packed.shape[1];
  return { at: (frame, row, column = 0) => values[(frame * rows + row) * width + column], count: packed.shape[0] };
}
for (const person of data.people) {
  for (const name of ["positions", "angles", "bends", "deviations", "observed"]) person[name] = unpack(person[name]);
  person.views = [person, ...person.others];
  for (const view of person.views) for (const name of ["outline", "detected", "reprojected"]) view[name] = unpack(view[name]);
}

const J = data.joints.length, L = data.landmarks.length;
const bones = { left: [], right: [], middle: [] };
data.parents.forEach((parent, joint) => { if (parent >= 0) bones[side(data.joints[joint])].push([parent, joint]); });
let me = data.people[0], frame = 0, playing = false, clock = 0, busy = false, cursorAt = 0;
let camera = 0;                                          // number of the camera whose image is shown
const inCamera = () => me.views[camera];
const imageSize = () => data.cameras[camera].image;
const photosOfCamera = () => (camera ? photos.others[camera - 1] : photos);
