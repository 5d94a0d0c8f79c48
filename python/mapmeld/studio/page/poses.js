// Rigid transforms of the plane as [x, y, theta]: T_a_b takes coordinates of frame b to frame a.

export function compose(a, b) {
  const c = Math.cos(a[2]), s = Math.sin(a[2]);
  return [a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], wrap(a[2] + b[2])];
}

export function inverse(t) {
  const c = Math.cos(t[2]), s = Math.sin(t[2]);
  return [-(c * t[0] + s * t[1]), s * t[0] - c * t[1], -t[2]];
}

export function apply(t, p) {
  const c = Math.cos(t[2]), s = Math.sin(t[2]);
  return [t[0] + c * p[0] - s * p[1], t[1] + s * p[0] + c * p[1]];
}

export function wrap(angle) {
  return Math.atan2(Math.sin(angle), Math.cos(angle));
}

/** The pose after a turn about a point of the outer frame. */
export function turned(t, about, angle) {
  const [x, y] = apply([0, 0, angle], [t[0] - about[0], t[1] - about[1]]);
  return [about[0] + x, about[1] + y, wrap(t[2] + angle)];
}
