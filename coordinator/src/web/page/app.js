// The farm's page: jobs and workers as they are. Every event says how things stand, so that a reconnect misses nothing.
import { Curve } from './curve.js';
import { Picture } from './picture.js';

const $ = id => document.getElementById(id);
const picture = new Picture($('picture'), $('tint'), $('readout'));
const curve = new Curve($('curve'), $('curve-title'));
const speeds = new Map();
let heard = 0, hearing = false;
let chosen = null, followNewest = true, source = null, changes = -1, loading = false;

const seconds = s => s == null ? '–' : s < 0.1 ? `${Math.round(1000 * s)} ms` : s < 10 ? `${s.toFixed(1)} s` : s < 60 ? `${Math.round(s)} s`
  : s < 3600 ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` : `${Math.floor(s / 3600)} h ${Math.floor(s / 60 % 60)} min`;
const mega = n => (n / 1e6).toFixed(n < 1e7 ? 2 : 1);

async function get(path) {
  const answer = await fetch('/api/v1/' + path);
  if (answer.status === 401) location.replace('/login' + location.hash);
  if (!answer.ok) throw new Error((await answer.json().catch(() => ({}))).error ?? answer.statusText);
  return answer.json();
}

// The header says that no other site's form asks for this.
const send = path => fetch(path, { method: 'POST', headers: { 'X-Tessera': '1' } });

async function post(path) {
  const answer = await send('/api/v1/' + path);
  if (!answer.ok) $('summary').textContent = (await answer.json().catch(() => ({}))).error ?? answer.statusText;
  refresh();
}

function element(name, text, attributes = {}) {
  const made = document.createElement(name);
  if (text != null) made.textContent = text;
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
}

function button(text, label, act) {
  const made = element('button', text, { 'aria-label': label });
  made.addEventListener('click', act);
  return made;
}

function choose(id) {
  chosen = id;
  location.hash = id;
  connect();
  refresh();
}

function jobRow(job) {
  const row = element('tr', null, { 'aria-selected': job.id === chosen });
  const open = button(job.name || `job ${job.id}`, `show job ${job.id}, ${job.name}`, () => { followNewest = false; choose(job.id); });
  open.className = 'open';
  const name = element('td', null, { class: 'name', title: job.failure ?? job.name });
  name.append(open);
  const actions = element('td');
  for (const what of job.actions) actions.append(button(what, `${what} job ${job.id}`, () => post(`jobs/${job.id}/${what}`)));
  const share = job.state === 'done' ? '100 %' : job.progress ? `${Math.floor(100 * job.progress.share)} %` : '';
  row.append(element('td', job.id), name, element('td', job.owner), element('td', job.state, { class: job.state }), element('td', share), actions);
  return row;
}

function workerRow(worker, canDrain) {
  // The speed over the time since it was last looked at, and of earlier times.
  const now = performance.now(), known = speeds.get(worker.name) ?? { at: now, rays: worker.rays, past: [] };
  if (now - known.at > 900) {
    known.past.push((worker.rays - known.rays) / (now - known.at) * 1000);
    known.past.splice(0, known.past.length - 60);
    [known.at, known.rays] = [now, worker.rays];
  }
  speeds.set(worker.name, known);
  const row = element('tr');
  const line = element('canvas', null, { class: 'spark', width: 180, height: 42, 'aria-hidden': 'true' });
  const pen = line.getContext('2d'), most = Math.max(1, ...known.past);
  pen.strokeStyle = getComputedStyle(document.body).getPropertyValue('color');
  pen.lineWidth = 2;
  pen.beginPath();
  known.past.forEach((value, n) => pen.lineTo(2 + n * 176 / 59, 39 - 36 * value / most));
  pen.stroke();
  const over = element('td'), actions = element('td');
  over.append(line);
  if (canDrain && !worker.draining) actions.append(button('drain', `have ${worker.name} leave`, () => post(`workers/${encodeURIComponent(worker.name)}/drain`)));
  row.append(element('td', worker.name, { class: 'name', title: worker.address }), element('td', worker.threads),
    element('td', worker.draining ? 'leaving' : worker.job ?? 'idle'), element('td', mega(known.past.at(-1) ?? 0)), over,
    element('td', worker.tiles), element('td', worker.verified || ''), element('td', worker.lost || ''), actions);
  return row;
}

function replace(body, rows) {
  const label = body.contains(document.activeElement) ? document.activeElement.getAttribute('aria-label') : null;
  body.replaceChildren(...rows);
  // Whoever works by keyboard stays where he was.
  if (label) [...body.querySelectorAll('button')].find(b => b.getAttribute('aria-label') === label)?.focus();
}

async function refresh() {
  if (loading) return;
  loading = true;
  try {
    const [jobs, workers] = await Promise.all([get('jobs?limit=200'), get('workers')]);
    replace($('job-rows'), jobs.jobs.reverse().map(jobRow));
    replace($('worker-rows'), workers.workers.map(w => workerRow(w, workers.can_drain)));
    $('counts').textContent = Object.entries(jobs.counts).map(([state, count]) => `${count} ${state}`).join(', ');
    $('summary').textContent = `${workers.count} worker${workers.count === 1 ? '' : 's'}, ${jobs.counts.rendering ?? 0} rendering, ${jobs.counts.queued ?? 0} queued`;
    const newest = jobs.jobs.find(j => j.state === 'rendering') ?? jobs.jobs[0];
    if (chosen == null && newest && followNewest) choose(newest.id);
  } catch { /* the stream of events says that the connection is lost */ }
  loading = false;
}

// What happened since the last line that was heard. A farm that was started anew tells all from the beginning.
async function hear(next) {
  if (hearing) return;
  hearing = true;
  try {
    const said = await get(`log?since=${heard > next ? 0 : heard}`);
    const lines = said.lines.map(line => {
      const item = element('li', null, { class: line.level });
      item.append(element('time', new Date(line.at_ms).toLocaleTimeString(), { datetime: new Date(line.at_ms).toISOString() }), ' ' + line.text);
      return item;
    });
    $('log-lines').prepend(...lines.reverse());
    while ($('log-lines').children.length > 500) $('log-lines').lastElementChild.remove();
    heard = said.next;
  } catch { /* told elsewhere */ }
  hearing = false;
}

function figures(job) {
  const p = job.progress, r = job.result;
  const rows = { state: job.state };
  if (job.owner) rows.owner = job.owner;
  if (job.region) rows.size = `${job.region[2] - job.region[0]} × ${job.region[3] - job.region[1]}`;
  if (p?.error_steps != null) rows['error so far'] = `${+p.error_steps.toPrecision(3)} steps`;
  if (job.target_steps) rows['error asked for'] = `${+job.target_steps.toPrecision(3)} steps`;
  if (p) Object.assign(rows, {
    pass: p.look ? `look ${p.pass}` : p.pass, tiles: `${p.tiles_done} / ${p.tiles_total}`, workers: p.workers,
    'Mrays/s': mega(p.elapsed_seconds > 0 ? p.rays / p.elapsed_seconds : 0), elapsed: seconds(p.elapsed_seconds), 'to go': seconds(p.remaining_seconds),
  });
  if (r) Object.assign(rows, { took: seconds(r.trace_seconds), passes: r.passes, Mrays: mega(r.rays), target: r.target_met == null ? 'none' : r.target_met ? 'met' : 'missed' });
  if (job.failure) rows.failure = job.failure;
  $('figures').replaceChildren(...Object.entries(rows).map(([key, value]) => {
    const pair = element('div');
    pair.append(element('dt', key), element('dd', value));
    return pair;
  }));
  const share = job.state === 'done' ? 1 : p?.share ?? 0;
  $('progress').firstElementChild.style.width = `${100 * share}%`;
  $('progress').setAttribute('aria-valuenow', Math.floor(100 * share));
  $('title').textContent = `${job.id} · ${job.name}`;
  $('picture').setAttribute('aria-label', `The picture of job ${job.id}, ${job.name}: ${Math.floor(100 * share)} % done`);
}

function connect() {
  source?.close();
  source = new EventSource('/api/v1/events' + (chosen == null ? '' : `?job=${chosen}`));
  source.addEventListener('state', event => {
    $('lost').hidden = true;
    const state = JSON.parse(event.data);
    if (state.log !== heard) hear(state.log);
    if (state.changes !== changes) { changes = state.changes; refresh(); }
    if (state.job) {
      $('empty').hidden = true;
      figures(state.job);
      picture.show(state.job, state.tiles);
      curve.show(state.job);
    }
  });
  source.onerror = () => {
    $('lost').hidden = false;
    changes = -1;
    // A farm that is started anew begins its tiles anew.
    picture.forget();
    heard = 0;
    $('log-lines').replaceChildren();
    if (source.readyState === EventSource.CLOSED) setTimeout(connect, 1000);
  };
}

$('overlay').addEventListener('change', event => picture.overlay(event.target.value));
$('fit').addEventListener('click', () => picture.fit());
$('in').addEventListener('click', () => picture.zoom(1.5));
$('out').addEventListener('click', () => picture.zoom(1 / 1.5));
$('logout').hidden = location.protocol !== 'https:';
$('logout').addEventListener('click', () => send('/logout').finally(() => location.replace('/login')));
if (/^#\d+$/.test(location.hash)) { chosen = +location.hash.slice(1); followNewest = false; }
connect();
refresh();
setInterval(refresh, 2000);
