// The moving gas. Decoding and positions need no page: tests run them beside Python.

export function decode(head, base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  const {n, dim, events} = head;
  let at = 0;
  const take = (Kind, count) => { const a = new Kind(bytes.buffer, at, count); at += a.byteLength; return a; };
  const positions = take(Float64Array, n * dim), velocities = take(Float64Array, n * dim);
  const radii = take(Float64Array, n), masses = take(Float64Array, n);
  const time = take(Float64Array, events), push = take(Float64Array, events * dim);
  const first = take(Int32Array, events), second = take(Int32Array, events), species = take(Int32Array, n);
  const label = head.labels && take(Int32Array, n);
  return {...head, positions, velocities, radii, masses, time, push, first, second, species, label};
}

// Flights, straight or parabolas: 0 to n-1 begin at the start, n+2e and n+2e+1 at event e. Each knows the one before.
export class Gas {
  constructor(data) {
    Object.assign(this, data);
    this.gravity ??= this.box.map(() => 0);
    const {n, dim, events} = this, flights = n + 2 * events;
    this.began = new Float64Array(flights);
    this.x = new Float64Array(flights * dim); this.v = new Float64Array(flights * dim);
    this.before = new Int32Array(flights).fill(-1);
    this.falls = Float64Array.from({length: flights}, (_, i) => +(i >= n || !this.obstacle(i))); // 0 for obstacles
    this.flight = Int32Array.from({length: n}, (_, i) => i);
    this.x.set(this.positions); this.v.set(this.velocities);
    this.done = 0; this.t = 0;
    for (let e = 0; e < events; e++) {
      this.turn(e, this.first[e], n + 2 * e, 1);
      if (this.second[e] < n) this.turn(e, this.second[e], n + 2 * e + 1, -1);
    }
    this.follow();
    for (let i = 0; i < n; i++) this.flight[i] = i; // back to the start
  }

  turn(e, i, p, sign) {
    const {dim} = this, q = this.flight[i], m = this.masses[i];
    this.began[p] = this.time[e]; this.before[p] = q; this.flight[i] = p; this.falls[p] = this.falls[q];
    for (let k = 0; k < dim; k++) {
      this.x[p * dim + k] = this.place(q, k, this.time[e]);
      this.v[p * dim + k] = this.velocity(q, k, this.time[e]) + sign * this.push[e * dim + k] / m;
    }
  }

  place(p, k, t) { // of a flight
    const dt = t - this.began[p], at = p * this.dim + k;
    return this.x[at] + (this.v[at] + .5 * this.falls[p] * this.gravity[k] * dt) * dt;
  }

  velocity(p, k, t) { return this.v[p * this.dim + k] + this.falls[p] * this.gravity[k] * (t - this.began[p]); }

  redo() {
    const e = this.done++, p = this.n + 2 * e;
    this.flight[this.first[e]] = p;
    if (this.second[e] < this.n) this.flight[this.second[e]] = p + 1;
  }

  undo() {
    const e = --this.done, p = this.n + 2 * e;
    if (this.second[e] < this.n) this.flight[this.second[e]] = this.before[p + 1];
    this.flight[this.first[e]] = this.before[p];
  }

  seek(t) {
    this.t = Math.min(Math.max(t, 0), this.duration);
    while (this.done < this.events && this.time[this.done] <= this.t) this.redo();
    while (this.done > 0 && this.time[this.done - 1] > this.t) this.undo();
  }

  next() { if (this.done < this.events) { this.t = this.time[this.done]; this.redo(); } else this.t = this.duration; }

  previous() {
    if (this.done > 0 && this.t <= this.time[this.done - 1]) this.undo();
    this.t = this.done > 0 ? this.time[this.done - 1] : 0;
  }

  coordinate(i, k) { // within [0, L) on periodic axes
    const x = this.place(this.flight[i], k, this.t), L = this.box[k];
    if (!this.periodic[k]) return x;
    const inside = x - L * Math.floor(x / L);
    return inside >= L ? 0 : inside;
  }

  positionsNow() {
    const out = new Float64Array(this.n * this.dim);
    for (let i = 0; i < this.n; i++) for (let k = 0; k < this.dim; k++) out[i * this.dim + k] = this.coordinate(i, k);
    return out;
  }

  squaredSpeed(p) { // of a flight now, relative to the drift
    let sum = 0;
    for (let k = 0; k < this.dim; k++) sum += (this.velocity(p, k, this.t) - this.drift[k]) ** 2;
    return sum;
  }

  obstacle(i) { return this.masses[i] === Infinity; } // nothing moves it, and it counts in no sum

  follow() { // collisions per particle s = 2 c / N and a2 after each event
    const {n, dim, events} = this, masses = this.masses.map(m => m === Infinity ? 0 : m);
    const total = masses.reduce((a, b) => a + b, 0);
    this.moving = masses.reduce((count, m) => count + (m > 0), 0);
    this.drift = Array.from({length: dim}, (_, k) => {
      if (!this.periodic[k] || !this.fixed()) return 0;
      let p = 0;
      for (let i = 0; i < n; i++) p += masses[i] * this.velocities[i * dim + k];
      return p / total;
    });
    const c = this.gravity.reduce((sum, g) => sum + g * g, 0);
    const terms = (p, i) => { // of m v^2 and of its square in powers of time
      let a = 0, b = 0;
      for (let k = 0; k < dim; k++) {
        const w = this.velocity(p, k, 0) - this.drift[k];
        a += w * w; b += 2 * w * this.gravity[k];
      }
      const m = masses[i];
      return [m * a, m * b, m * c, m * m * a * a, 2 * m * m * a * b, m * m * (b * b + 2 * a * c), 2 * m * m * b * c, m * m * c * c];
    };
    const sums = new Float64Array(8);
    const add = (p, i, sign) => terms(p, i).forEach((x, k) => { sums[k] += sign * x; });
    let partners = 0;
    for (let i = 0; i < n; i++) add(i, i, 1);
    const two = t => sums[0] + t * (sums[1] + t * sums[2]);
    const a2 = t => {
      const all = two(t);
      const four = sums[3] + t * (sums[4] + t * (sums[5] + t * (sums[6] + t * sums[7])));
      return all > 0 ? dim * this.moving * four / ((dim + 2) * all * all) - 1 : 0;
    };
    this.s = new Float64Array(events + 1); this.a2 = new Float64Array(events + 1);
    this.a2[0] = a2(0); this.hottest = 0; // where it falls, largest m v^2 of a particle and axis on average
    for (let e = 0; e < events; e++) {
      for (const [i, p] of [[this.first[e], n + 2 * e], [this.second[e], n + 2 * e + 1]]) {
        if (i >= n) continue;
        add(this.before[p], i, -1); add(p, i, 1);
      }
      if (this.second[e] < n) partners += !this.obstacle(this.first[e]) + !this.obstacle(this.second[e]);
      this.s[e + 1] = partners / this.moving; this.a2[e + 1] = a2(this.time[e]);
      if (c > 0) this.hottest = Math.max(this.hottest, two(this.time[e]) / (this.moving * dim));
    }
  }

  // The last event, its unit vector along the line of centres and the velocities split along it and across.
  rule() {
    if (!this.done) return null;
    const e = this.done - 1, {dim, n} = this, push = this.push.subarray(e * dim, (e + 1) * dim);
    const size = Math.hypot(...push), normal = Array.from(push, x => size > 0 ? x / size : 0);
    const split = (i, p) => {
      const parts = q => {
        const v = Array.from({length: dim}, (_, k) => this.velocity(q, k, this.time[e]));
        const along = v.reduce((sum, x, k) => sum + x * normal[k], 0);
        return {v, along, across: v.map((x, k) => x - along * normal[k])};
      };
      return {i, radius: this.radii[i], before: parts(this.before[p]), after: parts(p)};
    };
    const bodies = [split(this.first[e], n + 2 * e)];
    if (this.second[e] < n) bodies.push(split(this.second[e], n + 2 * e + 1));
    const most = Math.max(...bodies.flatMap(b => [b.before, b.after].map(p => Math.hypot(...p.v)))) || 1;
    return {time: this.time[e], normal, bodies, most};
  }

  temperatures() { // of each species: m (v - u)^2 over its degrees of freedom, less its share of those of the drift
    const {dim, n} = this, kinds = [];
    for (let i = 0; i < n; i++) {
      const kind = kinds[this.species[i]] ??= {count: 0, sum: 0, mass: this.masses[i]};
      kind.count++;
      if (!this.obstacle(i)) kind.sum += this.masses[i] * this.squaredSpeed(this.flight[i]);
    }
    const total = kinds.reduce((sum, k) => sum + k.count * k.mass, 0);
    return kinds.map(({count, mass, sum}) => {
      if (mass === Infinity) return {count, mass, kT: 0};
      const freedom = count * dim - this.fixed() * count * mass / total; // 0 of one obstacle of nearly all the mass
      return {count, mass, kT: freedom > 1e-9 ? sum / freedom : 0};
    });
  }

  fixed() { return this.n < 2 || this.moving < this.n ? 0 : this.periodic.filter(Boolean).length; } // degrees of freedom of the drift

  // What a2 is on average where all velocities of this energy are equally likely: -2 / (degrees of freedom + 2).
  thermalA2() { return -2 / (this.moving * this.dim - this.fixed() + 2); }
}

const RAMP = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]]; // viridis
const LEVELS = 24;
const ramp = f => {
  const x = Math.min(Math.max(f, 0), 1) * (RAMP.length - 1), k = Math.min(Math.floor(x), RAMP.length - 2);
  return `rgb(${RAMP[k].map((c, j) => Math.round(c + (RAMP[k + 1][j] - c) * (x - k))).join(",")})`;
};

function sphere(colour, size) { // the picture of one
  const canvas = new OffscreenCanvas(size, size), g = canvas.getContext("2d"), r = size / 2;
  g.fillStyle = colour; g.beginPath(); g.arc(r, r, r - .5, 0, 7); g.fill();
  const light = g.createRadialGradient(.68 * r, .62 * r, .04 * r, r, r, r);
  light.addColorStop(0, "rgba(255,255,255,.75)"); light.addColorStop(0.35, "rgba(255,255,255,.05)");
  light.addColorStop(1, "rgba(0,0,0,.5)");
  g.fillStyle = light; g.fill();
  return canvas.transferToImageBitmap(); // drawn in a third of the time that a canvas takes
}

function start() {
  const $ = id => document.getElementById(id);
  const gas = new Gas(decode(JSON.parse($("head").textContent), $("data").textContent.trim()));
  const {n, dim, box, duration} = gas, centre = box.map(L => L / 2), kinds = gas.temperatures();
  const ways = ["speed", ...kinds.length > 1 ? ["species"] : [], ...gas.labels ? ["label"] : []]; // to colour
  let playing = false, direction = 1, rate = duration / 60, way = ways.length - 1, shown = false, dirty = true;
  let turned = [0.5, -0.35], last = 0;
  const fastest = Math.max(...kinds.map(k => 3 * Math.sqrt(Math.max(k.kT, gas.hottest) / k.mass))) || 1;
  const upright = dim === 3 && gas.gravity[2] ? 2 : dim === 3 && gas.gravity[0] ? 0 : 1; // the axis that is drawn upright
  let ink, faint, paper, accent, palette, colours, sprites; // of the light page or the dark one
  const dark = matchMedia("screen and (prefers-color-scheme: dark)");
  const theme = () => {
    const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    [ink, faint, paper, accent] = ["--ink", "--faint", "--paper", "--accent"].map(css);
    palette = css("--palette").split(" ");
    const [from, to] = css("--ramp").split(" ").map(Number);
    colours = Array.from({length: LEVELS}, (_, k) => ramp(from + (to - from) * k / (LEVELS - 1))).concat(palette, faint);
    sprites = dim === 3 && [96, 24].map(size => colours.map(colour => sphere(colour, size)));
  };
  const fit = canvas => { // to its place on the page, sharp on every screen
    const d = devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * d) || canvas.height !== Math.round(h * d)) {
      canvas.width = Math.round(w * d); canvas.height = Math.round(h * d);
    }
    const g = canvas.getContext("2d");
    g.setTransform(d, 0, 0, d, 0, 0); g.clearRect(0, 0, w, h);
    g.font = "12px system-ui, sans-serif"; g.lineWidth = 1; g.setLineDash([]); g.textAlign = "left";
    return [g, w, h];
  };
  const level = speed => Math.min(Math.floor(LEVELS * speed / fastest), LEVELS - 1);
  const colour = i => {
    if (gas.obstacle(i)) return colours.length - 1;
    if (ways[way] !== "speed") return LEVELS + (ways[way] === "label" ? gas.label : gas.species)[i] % palette.length;
    return level(Math.sqrt(gas.squaredSpeed(gas.flight[i])));
  };
  const legend = () => { // of the colours
    const name = ways[way], swatch = colour => `<i style="background:${colour}"></i>`;
    const bar = `<i class="bar" style="background:linear-gradient(90deg,${colours.slice(0, LEVELS).join(",")})"></i>`;
    const groups = name === "label" ? gas.labels.map(label => `label ${label}`)
      : kinds.map((kind, k) => kind.mass === Infinity ? "obstacles" : `species ${k + 1}, mass ${+kind.mass.toPrecision(3)}`);
    const own = k => name === "species" && kinds[k].mass === Infinity ? faint : palette[k % palette.length];
    $("legend").innerHTML = name === "speed"
      ? `speed 0 ${bar} ${fastest.toPrecision(3)}${kinds.length > 1 || gas.hottest ? "" : " = 3 √(kT/m)"}`
      : groups.slice(0, 8).map((text, k) => `<span>${swatch(own(k))} ${text}</span>`).join(" ") +
        (groups.length > 8 ? ` and so on: ${groups.length} of them, and colours repeat` : "");
    $("colour").textContent = `by ${name}`;
    $("colour").hidden = ways.length < 2;
  };
  const arrow = (g, x, y, dx, dy, style, width = 2, dash = []) => {
    const size = Math.hypot(dx, dy);
    if (size < 1) return;
    const tip = Math.min(8, size), ux = dx / size, uy = dy / size;
    g.strokeStyle = g.fillStyle = style; g.lineWidth = width; g.setLineDash(dash);
    g.beginPath(); g.moveTo(x, y); g.lineTo(x + dx - ux * tip * .6, y + dy - uy * tip * .6); g.stroke();
    g.setLineDash([]); g.beginPath(); g.moveTo(x + dx, y + dy);
    g.lineTo(x + dx - tip * (ux + .45 * uy), y + dy - tip * (uy - .45 * ux));
    g.lineTo(x + dx - tip * (ux - .45 * uy), y + dy - tip * (uy + .45 * ux)); g.fill();
  };

  function camera(w, h) { // [across, down, depth, pixels per length] of a point
    if (dim === 2) {
      const scale = Math.min((w - 28) / box[0], (h - 28) / box[1]);
      return x => [w / 2 + (x[0] - centre[0]) * scale, h / 2 - (x[1] - centre[1]) * scale, 0, scale];
    }
    const [a, b] = turned, size = Math.hypot(...box), scale = Math.min(w, h) / size, far = 2.2 * size;
    const ca = Math.cos(a), sa = Math.sin(a), cb = Math.cos(b), sb = Math.sin(b);
    return x => {
      const [u, v, z] = [upright + 2, upright, upright + 1].map(k => x[k % 3] - centre[k % 3]);
      const across = u * ca + z * sa, deep = z * ca - u * sa, up = v * cb - deep * sb, depth = v * sb + deep * cb;
      const s = scale * far / (far - depth);
      return [w / 2 + across * s, h / 2 - up * s, depth, s];
    };
  }

  function discs(g, see, rule) { // at a collision the two that collide stand out
    const [left, top, , scale] = see([0, box[1]]), right = left + box[0] * scale, bottom = top + box[1] * scale;
    const groups = colours.map(() => []);
    for (let i = 0; i < n; i++) groups[colour(i)].push(i);
    g.save(); g.beginPath(); g.rect(left, top, right - left, bottom - top); g.clip();
    const paint = (members, level) => {
      if (!members.length) return;
      g.fillStyle = colours[level]; g.beginPath();
      for (const i of members) {
        const r = gas.radii[i], x = gas.coordinate(i, 0), y = gas.coordinate(i, 1);
        const xs = images(x, r, 0), ys = images(y, r, 1);
        for (const u of xs) for (const v of ys) {
          const px = left + u * scale, py = bottom - v * scale, pr = Math.max(r * scale, .7);
          g.moveTo(px + pr, py); g.arc(px, py, pr, 0, 6.2832);
        }
      }
      g.fill();
      if (n <= 2000) { g.strokeStyle = paper; g.lineWidth = .7; g.stroke(); }
    };
    g.globalAlpha = rule ? .35 : 1;
    groups.forEach(paint);
    g.globalAlpha = 1;
    if (rule) for (const {i} of rule.bodies) paint([i], colour(i));
    g.restore();
    for (const [axis, lines] of [[0, [[left, top, left, bottom], [right, top, right, bottom]]],
      [1, [[left, top, right, top], [left, bottom, right, bottom]]]]) {
      g.strokeStyle = ink; g.lineWidth = gas.periodic[axis] ? 1 : 3; g.setLineDash(gas.periodic[axis] ? [5, 5] : []);
      for (const [a, b, c, d] of lines) { g.beginPath(); g.moveTo(a, b); g.lineTo(c, d); g.stroke(); }
    }
    g.setLineDash([]);
  }

  function images(x, r, axis) { // itself, and where it reaches over a periodic border
    const L = box[axis];
    if (!gas.periodic[axis]) return [x];
    return x < r ? [x, x + L] : x > L - r ? [x, x - L] : [x];
  }

  function edges(g, see, front) {
    for (let axis = 0; axis < 3; axis++) for (let corner = 0; corner < 4; corner++) {
      const from = [0, 0, 0], [p, q] = [0, 1, 2].filter(k => k !== axis);
      from[p] = corner & 1 ? box[p] : 0; from[q] = corner & 2 ? box[q] : 0;
      const to = from.slice(); to[axis] = box[axis];
      const a = see(from), b = see(to);
      if ((a[2] + b[2] > 0) !== front) continue;
      const solid = !(gas.periodic[p] && gas.periodic[q]);
      g.strokeStyle = front ? ink : faint; g.lineWidth = solid ? 2 : 1; g.setLineDash(solid ? [] : [5, 5]);
      g.beginPath(); g.moveTo(a[0], a[1]); g.lineTo(b[0], b[1]); g.stroke();
    }
    g.setLineDash([]);
    if (front) return;
    for (let axis = 0; axis < 3; axis++) for (const side of [0, box[axis]]) { // walls at the back
      const [p, q] = [0, 1, 2].filter(k => k !== axis);
      if (gas.periodic[axis]) continue;
      const at = (u, v) => { const x = [0, 0, 0]; x[axis] = side; x[p] = u; x[q] = v; return see(x); };
      if (at(box[p] / 2, box[q] / 2)[2] > 0) continue;
      g.fillStyle = faint; g.globalAlpha = .25; g.beginPath();
      for (const [u, v] of [[0, 0], [box[p], 0], [box[p], box[q]], [0, box[q]]]) g.lineTo(...at(u, v).slice(0, 2));
      g.fill(); g.globalAlpha = 1;
    }
  }

  const order = Array.from({length: n}, (_, i) => i), seen = new Array(n), depth = new Float64Array(n);
  function spheres(g, see, rule) { // far ones first; at a collision the two that collide stand out
    edges(g, see, false);
    const x = [0, 0, 0], pixel = devicePixelRatio || 1;
    for (let i = 0; i < n; i++) {
      for (let k = 0; k < 3; k++) x[k] = gas.coordinate(i, k);
      seen[i] = see(x); depth[i] = seen[i][2];
    }
    const paint = i => {
      const [px, py, , s] = seen[i], r = Math.max(gas.radii[i] * s, .8);
      g.drawImage(sprites[+(r * pixel < 12)][colour(i)], px - r, py - r, 2 * r, 2 * r);
    };
    g.globalAlpha = rule ? .35 : 1;
    for (const i of order.sort((a, b) => depth[a] - depth[b])) paint(i);
    g.globalAlpha = 1;
    if (rule) rule.bodies.map(body => body.i).sort((a, b) => depth[a] - depth[b]).forEach(paint);
    edges(g, see, true);
  }

  function mark(g, see, rule) { // those that collide, the line of centres, velocities before and after
    const scale = velocity => velocity * .12 * Math.min(...box) / rule.most;
    for (const body of rule.bodies) {
      const x = Array.from({length: dim}, (_, k) => gas.coordinate(body.i, k)), [px, py, , s] = see(x);
      const end = v => { const q = see(x.map((c, k) => c + scale(v[k]))); return [q[0] - px, q[1] - py]; };
      const line = t => see(x.map((c, k) => c + t * rule.normal[k] * 2.2 * body.radius));
      const [a, b] = [line(-1), line(1)];
      g.strokeStyle = accent; g.lineWidth = 1.5; g.setLineDash([4, 3]);
      g.beginPath(); g.moveTo(a[0], a[1]); g.lineTo(b[0], b[1]); g.stroke(); g.setLineDash([]);
      g.lineWidth = 3; g.beginPath(); g.arc(px, py, Math.max(body.radius * s, 2) + 2, 0, 7); g.stroke();
      arrow(g, px, py, ...end(body.before.v), ink, 2, [3, 3]); arrow(g, px, py, ...end(body.after.v), ink, 2.5);
    }
  }

  function drawRule() {
    const rule = shown && gas.rule(), [g, w, h] = fit($("rule"));
    if (!rule) { $("words").textContent = "Stop at a collision with next or previous."; return; }
    const [one, two] = rule.bodies;
    let side = dim === 2 ? [-rule.normal[1], rule.normal[0]]
      : one.before.across.map((x, k) => x - (two ? two.before.across[k] : 0)); // a plane of the page
    const size = Math.hypot(...side);
    side = side.map(x => size > 0 ? x / size : 0);
    const up = v => v.reduce((sum, x, k) => sum + x * side[k], 0);
    const radius = Math.max(...rule.bodies.map(b => b.radius)), unit = Math.min(w / 13, (h - 20) / 6);
    ["before", "after"].forEach((when, column) => {
      const x0 = w * (column ? .75 : .25), y0 = (h - 4) / 2;
      g.fillStyle = ink; g.textAlign = "center"; g.fillText(when, x0, 14);
      g.strokeStyle = faint; g.lineWidth = 1; g.setLineDash([4, 3]); g.beginPath();
      g.moveTo(x0 - w * .23, y0); g.lineTo(x0 + w * .23, y0); g.stroke(); g.setLineDash([]);
      if (!two) { g.fillStyle = ink; g.fillRect(x0 - unit - 3, y0 - 2 * unit, 3, 4 * unit); } // the wall
      rule.bodies.forEach((body, k) => {
        const r = unit * body.radius / radius, x = two ? x0 + (k ? -1 : 1) * r : x0, part = body[when];
        g.globalAlpha = .35; g.fillStyle = colours[colour(body.i)]; g.beginPath(); g.arc(x, y0, r, 0, 7); g.fill();
        g.globalAlpha = 1; g.strokeStyle = ink; g.lineWidth = 1; g.stroke();
        const f = 2.6 * unit / rule.most, a = part.along * f, c = -up(part.across) * f;
        arrow(g, x, y0, a, c, faint, 1.5, [3, 2]);
        arrow(g, x, y0, a, 0, accent, 3); arrow(g, x, y0, 0, c, ink, 2);
      });
    });
    let x = 0;
    const line = two ? "line of centres" : "normal of the wall";
    for (const [text, style, dash] of [["along the " + line, accent, []], ["across it", ink, []], ["both", faint, [3, 2]]]) {
      arrow(g, x, h - 8, 22, 0, style, 2, dash); g.fillStyle = ink; g.textAlign = "left"; g.fillText(text, x + 26, h - 4);
      x += 38 + g.measureText(text).width;
    }
    const f = x => x.toPrecision(3).replace("-", "−");
    $("words").textContent = two
      ? `Particles ${one.i} and ${two.i}, t = ${rule.time.toPrecision(6)}. Along the line of centres: ` +
        `${f(one.before.along)} → ${f(one.after.along)} and ${f(two.before.along)} → ${f(two.after.along)}. Across it: unchanged.`
      : `Particle ${one.i} and a wall, t = ${rule.time.toPrecision(6)}. Along the wall's normal: ` +
        `${f(one.before.along)} → ${f(one.after.along)}. Across it: unchanged.`;
  }

  function drawSpeeds() {
    const [g, w, h] = fit($("speeds")), now = gas.temperatures(), many = now.length > palette.length;
    const bins = 30, reach = 1.15 * fastest, width = reach / bins, L = 8, B = h - 32, T = 8, R = w - 8;
    const moving = now.filter(k => k.mass !== Infinity);
    const groups = many ? [moving.reduce((a, k) => ({count: a.count + k.count, mass: 1, kT: 0}), {count: 0})] : now;
    const counts = groups.map(() => new Float64Array(bins));
    for (let i = 0; i < n; i++) {
      if (gas.obstacle(i)) continue;
      const bin = Math.floor(Math.sqrt(gas.squaredSpeed(gas.flight[i])) / width);
      if (bin < bins) counts[many ? 0 : gas.species[i]][bin] += 1 / (groups[many ? 0 : gas.species[i]].count * width);
    }
    const law = (v, {mass, kT}) => {
      const a = mass / kT;
      return dim === 2 ? a * v * Math.exp(-a * v * v / 2) : Math.sqrt(2 / Math.PI) * a ** 1.5 * v * v * Math.exp(-a * v * v / 2);
    };
    const peak = 1.7 * Math.max(...groups.filter(k => k.kT > 0).map(k => law(Math.sqrt((dim - 1) * k.kT / k.mass), k)), 1e-300);
    const px = v => L + (R - L) * v / reach, py = f => B - (B - T) * Math.min(f / peak, 1);
    groups.forEach((kind, s) => {
      if (kind.mass === Infinity) return;
      g.globalAlpha = groups.length > 1 ? .55 : 1;
      counts[s].forEach((f, k) => {
        g.fillStyle = groups.length > 1 ? palette[s] : colours[level((k + .5) * width)];
        g.fillRect(px(k * width) + .5, py(f), (R - L) / bins - 1, B - py(f));
      });
      g.globalAlpha = 1; g.strokeStyle = groups.length > 1 ? palette[s] : ink; g.lineWidth = 2; g.setLineDash(s ? [6, 3] : []);
      if (kind.kT > 0) {
        g.beginPath();
        for (let k = 0; k <= 120; k++) g.lineTo(px(k * reach / 120), py(law(k * reach / 120, kind)));
        g.stroke();
      }
      g.setLineDash([]); g.textAlign = "right"; g.fillStyle = ink;
      const name = groups.length > 1 ? `species ${s + 1}: ` : "";
      if (!many) {
        const text = `${name}kT = ${kind.kT.toPrecision(4)}`;
        g.fillText(text, R, T + 10 + 16 * s);
        g.fillStyle = palette[s];
        if (groups.length > 1) g.fillRect(R - g.measureText(text).width - 15, T + 2 + 16 * s, 9, 9);
      } else g.fillText(`no curve for ${now.length} species at once`, R, T + 10);
    });
    axes(g, L, R, T, B, reach, "speed");
  }

  function axes(g, L, R, T, B, end, name) {
    g.strokeStyle = faint; g.fillStyle = ink; g.lineWidth = 1;
    g.beginPath(); g.moveTo(L, B + .5); g.lineTo(R, B + .5); g.stroke();
    const raw = end / 5, ten = 10 ** Math.floor(Math.log10(raw)), step = ten * [1, 2, 5, 10].find(k => k * ten >= raw);
    for (let k = 0; k * step <= end * 1.0001; k++) {
      g.textAlign = k ? "center" : "left";
      g.fillText(+(k * step).toPrecision(3), L + (R - L) * k * step / end - (k ? 0 : 2), B + 14);
    }
    g.textAlign = "right"; g.fillText(name, R, B + 28);
  }

  let span = [0, 0], longest = gas.s[gas.events] || 1;
  function drawCourse() {
    const [g, w, h] = fit($("course")), L = 46, R = w - 8, T = 10, B = h - 32, m = gas.events;
    const thermal = gas.thermalA2();
    let low = -.05, high = .05;
    const points = Math.min(m + 1, 800), at = k => Math.round(k * m / Math.max(points - 1, 1));
    for (let k = 0; k < points; k++) { low = Math.min(low, gas.a2[at(k)]); high = Math.max(high, gas.a2[at(k)]); }
    const px = s => L + (R - L) * s / longest, py = a => B - (B - T) * (a - low) / (high - low);
    g.strokeStyle = ink; g.setLineDash([4, 4]); g.beginPath(); g.moveTo(L, py(thermal)); g.lineTo(R, py(thermal)); g.stroke();
    g.setLineDash([]); g.strokeStyle = palette[0]; g.lineWidth = 2; g.beginPath();
    for (let k = 0; k < points; k++) g.lineTo(px(gas.s[at(k)]), py(gas.a2[at(k)]));
    g.stroke();
    axes(g, L, R, T, B, longest, "s, collisions per particle");
    g.textAlign = "right";
    for (const a of [low, 0, high]) if (a === 0 || Math.abs(py(a) - py(0)) > 14) g.fillText(a ? a.toFixed(2) : "0", L - 5, py(a) + 4);
    const x = px(gas.s[gas.done]), y = py(gas.a2[gas.done]);
    g.strokeStyle = accent; g.beginPath(); g.moveTo(x, T); g.lineTo(x, B); g.stroke();
    g.fillStyle = accent; g.beginPath(); g.arc(x, y, 5, 0, 7); g.fill();
    span = [L, R];
  }

  function draw() {
    const [g, w, h] = fit($("gas")), see = camera(w, h), rule = shown && gas.rule();
    (dim === 2 ? discs : spheres)(g, see, rule);
    if (rule) mark(g, see, rule);
    drawSpeeds(); drawCourse(); drawRule();
    const pace = direction * rate * 60 / duration;
    $("numbers").textContent = (`t = ${gas.t.toPrecision(5)}   s = ${gas.s[gas.done].toFixed(2)}   ` +
      `a2 = ${gas.a2[gas.done].toFixed(3)}   pace ${+pace.toPrecision(2)}`).replaceAll("-", "−");
    $("slider").value = gas.done;
    $("slider").setAttribute("aria-valuetext", `s = ${gas.s[gas.done].toFixed(2)}`);
  }

  const play = on => {
    playing = on; shown = shown && !on; dirty = true;
    $("play").textContent = on ? "pause" : "play";
  };
  const step = forward => { play(false); forward ? gas.next() : gas.previous(); shown = gas.done > 0; dirty = true; };
  const jump = s => { // to the first event with this s
    let a = 0, b = gas.events;
    while (a < b) { const mid = (a + b) >> 1; if (gas.s[mid] < s) a = mid + 1; else b = mid; }
    gas.seek(a ? gas.time[a - 1] : 0); shown = false; dirty = true;
  };
  const actions = {
    play() { // at an end: from the other one
      if (!playing && gas.t === (direction > 0 ? duration : 0)) gas.seek(direction > 0 ? 0 : duration);
      play(!playing);
    },
    next: () => step(true), previous: () => step(false),
    faster() { rate *= 1.5; dirty = true; }, slower() { rate /= 1.5; dirty = true; },
    reverse() { direction = -direction; $("reverse").setAttribute("aria-pressed", direction < 0); play(true); },
    colour() { way = (way + 1) % ways.length; legend(); dirty = true; },
    help() { $("manual").open ? $("manual").close() : $("manual").showModal(); },
  };
  for (const name in actions) $(name).addEventListener("click", event => {
    actions[name]();
    if (event.detail) $(name).blur(); // a mouse or finger: space is to play, and not to press the same again
  });
  const keys = {" ": "play", ArrowRight: "next", ArrowLeft: "previous", "+": "faster", "=": "faster", "-": "slower",
    r: "reverse", c: "colour", "?": "help"};
  addEventListener("keydown", event => {
    const name = keys[event.key];
    if (!name || event.ctrlKey || event.metaKey || event.altKey || $("manual").open && name !== "help") return;
    if (event.key === " " && event.target.closest("nav button")) return; // it presses that one
    event.preventDefault(); actions[name]();
  });
  $("slider").max = gas.events;
  $("slider").addEventListener("input", event => {
    const k = +event.target.value;
    gas.seek(k ? gas.time[k - 1] : 0); shown = false; dirty = true;
  });
  const drag = (canvas, move) => {
    let held = null;
    canvas.addEventListener("pointerdown", e => { held = [e.offsetX, e.offsetY]; canvas.setPointerCapture(e.pointerId); move(e, 0, 0); });
    canvas.addEventListener("pointermove", e => {
      if (!held) return;
      move(e, e.offsetX - held[0], e.offsetY - held[1]); held = [e.offsetX, e.offsetY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  };
  drag($("course"), e => jump(longest * Math.min(Math.max((e.offsetX - span[0]) / (span[1] - span[0]), 0), 1)));
  if (dim === 3) drag($("gas"), (_, dx, dy) => {
    turned = [turned[0] + .008 * dx, Math.min(Math.max(turned[1] - .008 * dy, -1.5), 1.5)]; dirty = true;
  });
  else $("gas").style.touchAction = "auto";
  new ResizeObserver(() => { dirty = true; }).observe(document.body);
  const frame = now => {
    if (playing) {
      gas.seek(gas.t + direction * rate * Math.min((now - last) / 1000, .1));
      dirty = true;
      if (gas.t >= duration && direction > 0 || gas.t <= 0 && direction < 0) play(false);
    }
    last = now;
    if (dirty) { dirty = false; draw(); }
    requestAnimationFrame(frame);
  };
  const dress = () => { theme(); legend(); draw(); };
  dark.addEventListener("change", dress); // also before it is printed, where no frame comes
  dress();
  // It starts to move where it is the page, or in a frame of this name, and nobody asked for less motion.
  play((window.top === window || window.name === "play") && !matchMedia("(prefers-reduced-motion: reduce)").matches);
  requestAnimationFrame(frame);
  globalThis.replay = {gas, get playing() { return playing; }, get direction() { return direction; },
    get rate() { return rate; }, get shown() { return shown; }, get turned() { return turned; },
    get way() { return ways[way]; }};
}

if (typeof document !== "undefined") start();
