// The error of the picture over time, as it is earned: both logarithmic, as errors fall.
export class Curve {
  constructor(canvas, title) { Object.assign(this, { canvas, title, job: null, asked: 0, later: null }); }

  // Looks again once a second, and once more when the job is over.
  show(job) {
    if (this.job?.id !== job.id) { this.points = null; this.asked = 0; this.draw(job); }
    this.job = job;
    if (this.later || job.state !== 'rendering') return;
    this.later = setTimeout(() => { this.later = null; this.load(); }, Math.max(0, this.asked + 1000 - performance.now()));
  }

  async load() {
    const job = this.job;
    this.asked = performance.now();
    try {
      const answer = await fetch(`/api/v1/jobs/${job.id}/curve`);
      const curve = answer.ok ? await answer.json() : null;
      // What was seen stays when the picture is given away.
      if (curve?.seconds.length && this.job.id === job.id) this.points = curve.seconds.map((s, n) => [s, curve.error_steps[n]]).filter(([s, e]) => s > 0 && e > 0);
      this.draw(this.job);
    } catch { /* told elsewhere */ }
  }

  draw(job) {
    const { canvas, points } = this;
    canvas.hidden = this.title.hidden = !points?.length;
    if (canvas.hidden) return;
    const pen = canvas.getContext('2d'), wide = canvas.width = canvas.clientWidth * devicePixelRatio, high = canvas.height = canvas.clientHeight * devicePixelRatio;
    const style = getComputedStyle(canvas), left = 44 * devicePixelRatio, low = high - 18 * devicePixelRatio;
    const last = points.at(-1), errors = points.map(p => p[1]).concat(job.target_steps ?? []);
    const [s0, s1] = [points[0][0], Math.max(last[0], points[0][0] * 1.01)].map(Math.log);
    const [e0, e1] = [Math.min(...errors) / 1.2, Math.max(...errors) * 1.2].map(Math.log);
    const x = s => left + (Math.log(s) - s0) / (s1 - s0) * (wide - left - 4), y = e => 4 + (e1 - Math.log(e)) / (e1 - e0) * (low - 8);
    pen.font = `${11 * devicePixelRatio}px ${style.fontFamily}`;
    pen.fillStyle = style.color;
    const number = n => +n.toPrecision(2);
    pen.fillText(number(Math.exp(e1)), 0, 12 * devicePixelRatio);
    pen.fillText(number(Math.exp(e0)), 0, low);
    pen.fillText(`${number(Math.exp(s0))} s`, left, high - 3);
    const end = `${number(Math.exp(s1))} s`;
    pen.fillText(end, wide - pen.measureText(end).width - 4, high - 3);
    if (job.target_steps) {
      pen.strokeStyle = style.color;
      pen.setLineDash([4, 4]);
      pen.beginPath(); pen.moveTo(left, y(job.target_steps)); pen.lineTo(wide, y(job.target_steps)); pen.stroke();
      pen.setLineDash([]);
    }
    pen.strokeStyle = style.getPropertyValue('--accent');
    pen.lineWidth = 2 * devicePixelRatio;
    pen.beginPath();
    // A picture has an error until it is a better one.
    points.forEach(([s, e], n) => { if (n) pen.lineTo(x(s), y(points[n - 1][1])); pen.lineTo(x(s), y(e)); });
    pen.stroke();
    canvas.setAttribute('aria-label', `The error after ${number(last[0])} s is ${number(last[1])} steps`);
  }
}
