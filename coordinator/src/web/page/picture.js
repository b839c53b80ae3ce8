// The picture as it grows: the part in view is fetched at the size it is shown in, so that a huge one stays smooth.
const COLOURS = 12;

export class Picture {
  constructor(canvas, tint, readout) {
    Object.assign(this, { canvas, tint, readout, job: null, scale: 0, x: 0, y: 0, tiles: [], seen: 0, told: null, kind: '', busy: false, again: false });
    this.pen = canvas.getContext('2d');
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener('wheel', e => { e.preventDefault(); this.zoom(Math.exp(-e.deltaY / 400), e.offsetX, e.offsetY); }, { passive: false });
    const touches = new Map();
    canvas.addEventListener('pointerdown', e => { canvas.setPointerCapture(e.pointerId); touches.set(e.pointerId, e); });
    canvas.addEventListener('pointermove', e => {
      const before = touches.get(e.pointerId);
      if (!before) return this.read(e.offsetX, e.offsetY);
      const other = [...touches.values()].find(t => t.pointerId !== e.pointerId);
      if (other) {
        const apart = t => Math.hypot(t.offsetX - other.offsetX, t.offsetY - other.offsetY);
        this.zoom(apart(e) / Math.max(1, apart(before)), other.offsetX, other.offsetY);
      } else {
        this.x -= (e.offsetX - before.offsetX) / this.scale;
        this.y -= (e.offsetY - before.offsetY) / this.scale;
        this.draw();
      }
      touches.set(e.pointerId, e);
    });
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, e => { touches.delete(e.pointerId); this.load(); });
    canvas.addEventListener('keydown', e => {
      const step = 60 / this.scale;
      const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
      if (moves[e.key]) { this.x += moves[e.key][0]; this.y += moves[e.key][1]; this.draw(); this.load(); }
      else if (e.key === '+' || e.key === '=') this.zoom(1.5);
      else if (e.key === '-') this.zoom(1 / 1.5);
      else if (e.key === '0') this.fit();
      else return;
      e.preventDefault();
    });
  }

  // Shows a job; `tiles` of it came so far.
  show(job, tiles) {
    if (this.job?.id !== job.id) {
      this.job = job;
      this.forget();
      this.image = null;
      this.fit();
    }
    const state = `${job.state} ${tiles}`;
    this.job = job;
    if (this.told !== state) { this.told = state; this.load(); this.notes(tiles); }
  }

  forget() { Object.assign(this, { tiles: [], seen: 0, told: null }); }

  resize() {
    for (const canvas of [this.canvas, this.tint]) {
      canvas.width = this.canvas.clientWidth * devicePixelRatio;
      canvas.height = this.canvas.clientHeight * devicePixelRatio;
    }
    this.draw();
    this.load();
  }

  size() { const [x0, y0, x1, y1] = this.job.region; return [x1 - x0, y1 - y0]; }

  fit() {
    if (!this.job) return;
    const [w, h] = this.size();
    this.scale = Math.min(this.canvas.clientWidth / w, this.canvas.clientHeight / h);
    this.x = (w - this.canvas.clientWidth / this.scale) / 2;
    this.y = (h - this.canvas.clientHeight / this.scale) / 2;
    this.draw();
    this.load();
  }

  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    if (!this.job) return;
    const scale = Math.min(64, Math.max(0.002, this.scale * factor));
    this.x += px / this.scale - px / scale;
    this.y += py / this.scale - py / scale;
    this.scale = scale;
    this.draw();
    clearTimeout(this.later);
    this.later = setTimeout(() => this.load(), 120);
  }

  // Fetches the part in view, one request at a time: what came meanwhile is in the next.
  async load() {
    if (!this.job || this.scale <= 0) return;
    if (this.busy) { this.again = true; return; }
    this.busy = true;
    do {
      this.again = false;
      const job = this.job, [w, h] = this.size();
      const x0 = Math.max(0, Math.floor(this.x)), y0 = Math.max(0, Math.floor(this.y));
      const x1 = Math.min(w, Math.ceil(this.x + this.canvas.clientWidth / this.scale)), y1 = Math.min(h, Math.ceil(this.y + this.canvas.clientHeight / this.scale));
      if (x1 <= x0 || y1 <= y0) break;
      const dots = Math.min(1, this.scale * devicePixelRatio);
      const width = Math.max(1, Math.min(4096, Math.round((x1 - x0) * dots))), height = Math.max(1, Math.min(4096, Math.round((y1 - y0) * dots)));
      const [ox, oy] = job.region;
      try {
        const answer = await fetch(`/api/v1/jobs/${job.id}/picture.png?region=${ox + x0},${oy + y0},${ox + x1},${oy + y1}&width=${width}&height=${height}`);
        if (answer.ok) {
          const image = await createImageBitmap(await answer.blob());
          if (this.job.id === job.id) { this.image = image; this.part = [x0, y0, x1, y1]; this.draw(); }
        }
      } catch { /* told elsewhere */ }
      await new Promise(done => setTimeout(done, 200));
    } while (this.again);
    this.busy = false;
  }

  draw() {
    const { pen, canvas } = this;
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    if (this.image) {
      const [x0, y0, x1, y1] = this.part;
      pen.imageSmoothingEnabled = this.scale < 1;
      pen.drawImage(this.image, (x0 - this.x) * this.scale, (y0 - this.y) * this.scale, (x1 - x0) * this.scale, (y1 - y0) * this.scale);
    }
    this.drawTint();
  }

  async notes(tiles) {
    if (tiles == null || this.fetching) return;
    this.fetching = true;
    try {
      const job = this.job.id;
      for (let more = true; more;) {
        const answer = await (await fetch(`/api/v1/jobs/${job}/tiles?since=${this.seen}`)).json();
        if (job !== this.job.id) break;
        this.tiles.push(...answer.tiles);
        this.tiles.splice(0, this.tiles.length - 20000);
        more = answer.tiles.length > 0 && answer.next < tiles;
        this.seen = answer.next;
      }
      this.drawTint();
    } catch { /* told elsewhere */ }
    this.fetching = false;
  }

  overlay(kind) { this.kind = kind; this.drawTint(); }

  drawTint() {
    const pen = this.tint.getContext('2d');
    pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    pen.clearRect(0, 0, this.tint.clientWidth, this.tint.clientHeight);
    if (!this.kind || !this.job) return;
    const area = t => (t.region[2] - t.region[0]) * (t.region[3] - t.region[1]);
    const value = { error: t => t.error_steps ?? 0, cost: t => t.busy_seconds / area(t), pass: t => t.pass, worker: t => t.worker }[this.kind];
    const numbers = this.kind === 'worker' ? [] : this.tiles.map(value);
    const most = numbers.reduce((a, b) => Math.max(a, b), 1e-12);
    const names = [...new Set(this.tiles.map(t => t.worker))];
    const [ox, oy] = this.job.region;
    for (const tile of this.tiles) {
      const v = value(tile);
      pen.fillStyle = this.kind === 'worker' ? `hsl(${names.indexOf(v) % COLOURS * 360 / COLOURS} 70% 55%)` : `hsl(${260 - 260 * Math.sqrt(v / most)} 85% 55%)`;
      const [x0, y0, x1, y1] = tile.region;
      pen.fillRect((x0 - ox - this.x) * this.scale, (y0 - oy - this.y) * this.scale, (x1 - x0) * this.scale + .5, (y1 - y0) * this.scale + .5);
    }
  }

  read(px, py) {
    if (!this.job) return;
    const [w, h] = this.size(), x = Math.floor(this.x + px / this.scale), y = Math.floor(this.y + py / this.scale);
    if (x < 0 || y < 0 || x >= w || y >= h) return;
    clearTimeout(this.reading);
    this.reading = setTimeout(async () => {
      const [ox, oy] = this.job.region;
      const answer = await fetch(`/api/v1/jobs/${this.job.id}/pixel?x=${ox + x}&y=${oy + y}`).catch(() => null);
      if (!answer?.ok) return;
      const pixel = await answer.json();
      const tile = this.tiles.findLast(t => ox + x >= t.region[0] && ox + x < t.region[2] && oy + y >= t.region[1] && oy + y < t.region[3]);
      const parts = [`${ox + x}, ${oy + y}`];
      if (pixel.linear) parts.push('linear ' + pixel.linear.map(c => c.toFixed(5)).join(' '));
      if (pixel.encoded) parts.push('encoded ' + pixel.encoded.join(' '));
      if (tile) parts.push(`by ${tile.worker}, pass ${tile.pass}, ${(1e6 * tile.busy_seconds / ((tile.region[2] - tile.region[0]) * (tile.region[3] - tile.region[1]))).toFixed(1)} µs a pixel`);
      if (tile?.error_steps != null) parts.push(`error ${tile.error_steps.toFixed(3)} steps`);
      const swatch = document.createElement('span');
      swatch.className = 'swatch';
      if (pixel.encoded) swatch.style.background = `rgb(${pixel.encoded.join(' ')})`;
      this.readout.replaceChildren(swatch, parts.join(' · '));
    }, 60);
  }
}
