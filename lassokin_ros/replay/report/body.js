// The body: capsules between joints, as meshes. Limbs without keypoints are faint.
const AROUND = 10, RINGS = [-90, -55, -20, 20, 55, 90].map((degrees) => degrees * Math.PI / 180);
const SEEN = ["left", "right", "middle"], LIGHT = { ambient: 0.78, diffuse: 0.32, specular: 0.04, roughness: 0.9, fresnel: 0.02 };

const length3 = (v) => Math.hypot(v[0], v[1], v[2]);
const scaled = (v, factor) => v.map((value) => value * factor);
const added = (a, b) => a.map((value, i) => value + b[i]);
const between = (a, b) => a.map((value, i) => b[i] - value);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function addCapsule(mesh, start, end, radius) {          // a cylinder with a half sphere at each end
  const axis = between(start, end), size = length3(axis);
  const along = size > 1e-6 ? scaled(axis, 1 / size) : [0, 0, 1];
  const side = cross(along, Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
  const u = scaled(side, 1 / length3(side)), v = cross(along, u), first = mesh.x.length;
  for (const latitude of RINGS) {
    const centre = latitude < 0 ? start : end, wide = radius * Math.cos(latitude), ahead = radius * Math.sin(latitude);
    for (let n = 0; n < AROUND; n++) {
      const angle = 2 * Math.PI * n / AROUND;
      const point = added(added(centre, scaled(along, ahead)), added(scaled(u, wide * Math.cos(angle)), scaled(v, wide * Math.sin(angle))));
      mesh.x.push(point[0]);
      mesh.y.push(point[1]);
      mesh.z.push(point[2]);
    }
  }
  for (let ring = 0; ring + 1 < RINGS.length; ring++) {
    for (let n = 0; n < AROUND; n++) {
      const a = first + ring * AROUND + n, b = first + ring * AROUND + (n + 1) % AROUND;
      mesh.i.push(a, b);
      mesh.j.push(b, b + AROUND);
      mesh.k.push(a + AROUND, a + AROUND);
    }
  }
}

function bodyMeshes(get) {                               // get(joint): [x, y, z]; meshes of left, right, middle, then those not seen
  const meshes = [...SEEN, ...SEEN].map(() => ({ x: [], y: [], z: [], i: [], j: [], k: [] }));
  for (const [a, b, radius, of] of data.capsules) {
    const start = get(a), end = get(b);
    if ([...start, ...end].some(Number.isNaN)) continue;
    const tip = /_(foot|hand)$/.test(data.joints[b]);    // no keypoint is attached to the balls of feet and hands
    const seen = of === "middle" || (me.observed.at(frame, a) > 0 && (tip || me.observed.at(frame, b) > 0));
    addCapsule(meshes[SEEN.indexOf(of) + (seen ? 0 : 3)], start, end, radius);
  }
  if (data.skull) {                                      // the head: above the joint at the base of the skull
    const [neck, head, radius] = data.skull, base = get(head), up = between(get(neck), base), size = length3(up);
    const middle = added(base, scaled(up, 0.9 * radius / (size || 1))), top = added(base, scaled(up, 1.3 * radius / (size || 1)));
    if (![...middle, ...top].some(Number.isNaN)) addCapsule(meshes[2], middle, top, 0.85 * radius);
  }
  return meshes;
}
