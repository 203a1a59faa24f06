// Puts the page together: one time, that of the sound, for picture, map, house, charts and words.
'use strict';

function loadPicture(base64) {
  const picture = new Image();
  picture.src = 'data:image/jpeg;base64,' + base64;
  return picture.decode().then(() => picture);
}

class Player {
  constructor(clock, map, house, charts, pictures, depths) {
    Object.assign(this, {clock, map, house, charts, pictures, depths});
    this.step = -1;
    this.spokenAt = -Infinity;
    this.slowFrames = 0;
    this.get = id => document.getElementById(id);
    this.camera = this.prepare('camera', episode.pictures.width_px, episode.pictures.height_px);
    if (depths.length) this.depth = this.prepare('depth', depths[0].naturalWidth, depths[0].naturalHeight);
    this.get('depth').hidden = !depths.length;
    this.get('step').max = lastStep;
    this.listen();
    this.show(0);
    this.speak();
  }

  prepare(id, width, height) {
    const canvas = this.get(id);
    canvas.width = width;
    canvas.height = height;
    return canvas.getContext('2d', {willReadFrequently: true});  // drawn by the processor, which is never late
  }

  listen() {
    this.get('play').addEventListener('click', () => this.toggle());
    this.get('back').addEventListener('click', () => this.goTo(this.step - 1));
    this.get('on').addEventListener('click', () => this.goTo(this.step + 1));
    this.get('step').addEventListener('input', event => this.goTo(Number(event.target.value)));
    this.get('volume').addEventListener('input', event => {
      this.clock.volume = Number(event.target.value);
      this.clock.applyVolume();
    });
    for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => this.chooseView(button.dataset.view));
    document.addEventListener('keydown', event => this.key(event));
    calmQuery.addEventListener('change', () => this.show(this.clock.now()));
    const timeline = this.get('timeline');
    const seek = event => this.seek(this.charts.timeOf(event.clientX - timeline.getBoundingClientRect().left));
    timeline.addEventListener('pointerdown', event => {
      timeline.setPointerCapture(event.pointerId);
      this.scrubbing = true;
      seek(event);
    });
    timeline.addEventListener('pointermove', event => this.scrubbing && seek(event));
    timeline.addEventListener('pointerup', () => {
      this.scrubbing = false;
      this.speak();
    });
    window.addEventListener('resize', () => this.movePlayhead(this.clock.now()));
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const focused = event.target.tagName, many = event.shiftKey ? 10 : 1;
    if (event.key === ' ') {
      if (['BUTTON', 'SUMMARY', 'A'].includes(focused)) return;  // it presses what has the focus
      this.toggle();
    } else if (focused === 'INPUT' && event.key !== 'm') {
      return;  // a slider has keys of its own
    } else if (event.key === 'ArrowRight') {
      this.goTo(this.step + many);
    } else if (event.key === 'ArrowLeft') {
      this.goTo(this.step - many);
    } else if (event.key === 'Home') {
      this.goTo(0);
    } else if (event.key === 'End') {
      this.goTo(lastStep);
    } else if (event.key === 'm') {
      this.clock.muted = !this.clock.muted;
      this.clock.applyVolume();
    } else if (['1', '2', '3'].includes(event.key)) {
      this.chooseView(['overview', 'follow', 'eyes'][Number(event.key) - 1]);
    } else {
      return;
    }
    event.preventDefault();
  }

  chooseView(view) {
    for (const button of document.querySelectorAll('[data-view]')) button.setAttribute('aria-pressed', String(button.dataset.view === view));
    if (this.house) this.house.choose(view);
  }

  async toggle() {
    if (this.clock.playing) return this.pause();
    await this.clock.play();
    this.markPlaying();
    this.lastFrame = null;
    requestAnimationFrame(() => this.frame());
  }

  pause() {
    this.clock.pause();
    this.markPlaying();
    this.show(this.clock.now());
    this.speak();
  }

  markPlaying() {
    const button = this.get('play');
    button.setAttribute('aria-label', this.clock.playing ? 'Pause' : 'Play');
    button.textContent = this.clock.playing ? '\u275a\u275a' : '\u25b6';
  }

  /// To the middle of a step, so that no rounding can show its neighbour.
  goTo(step) {
    const wanted = Math.max(0, Math.min(lastStep, step));
    if (this.clock.playing) this.pause();
    this.seek((wanted + 0.5) * stepTime);
    this.speak();
  }

  seek(time) {
    this.clock.seek(time);
    this.show(this.clock.now());
  }

  frame() {
    if (!this.clock.playing) return;
    const started = performance.now();
    // Three frames in a row below 30 per second: the house is drawn in fewer pixels.
    this.slowFrames = this.lastFrame !== null && started - this.lastFrame > 34 ? this.slowFrames + 1 : 0;
    if (this.house && this.slowFrames >= 3) {
      this.house.lowerQuality();
      this.slowFrames = 0;
    }
    this.lastFrame = started;
    const time = this.clock.now();
    this.show(time);
    if (time >= duration - 1e-3) return this.pause();
    requestAnimationFrame(() => this.frame());
  }

  /// Everything at one time of the sound; what people look at for the step comes first.
  show(time) {
    const step = stepAt(time), calm = calmQuery.matches;
    if (step !== this.step) this.showStep(step);
    this.map.draw(time, step, calm);
    this.movePlayhead(time);
    this.get('time').textContent = `${time.toFixed(2)} of ${duration.toFixed(2)} s, step ${step} of ${lastStep}`;
    if (this.house && this.clock.playing) this.house.drawFrame(time, step, calm);
    else if (this.house) this.house.draw(time, step, calm);
    if (this.clock.playing && time - this.spokenAt > 4) this.speak();
  }

  showStep(step) {
    this.step = step;
    const words = stepWords(step), now = episode.steps[step];
    this.camera.drawImage(this.pictures[step], 0, 0);
    this.get('camera').dataset.step = step;
    if (this.depth && this.depths[step]) this.depth.drawImage(this.depths[step], 0, 0);
    this.get('readout').textContent = `${words}; ${now.walk_m === null ? 'no way' : now.walk_m.toFixed(1) + ' m'} on foot`;
    const slider = this.get('step');
    slider.value = step;
    slider.setAttribute('aria-valuetext', words);
    this.showPolicy(now, step < lastStep ? episode.steps[step + 1].action : null);
  }

  showPolicy(now, taken) {
    const panel = this.get('policy');
    panel.hidden = !episode.policy;
    if (!episode.policy) return;
    const names = ['stop', 'forward', 'left', 'right'];
    panel.replaceChildren(...names.map((name, action) => {
      const cell = document.createElement('div'), bar = document.createElement('i'), text = document.createElement('span');
      const part = now.probabilities ? now.probabilities[action] : 0;
      bar.style.width = `${100 * part}%`;
      text.textContent = now.probabilities ? `${name} ${Math.round(100 * part)} %` : name;
      cell.className = action === taken ? 'taken' : '';
      cell.append(bar, text);
      return cell;
    }));
  }

  movePlayhead(time) {
    this.get('playhead').style.left = `${this.charts.xOf(time)}px`;
  }

  /// For screen readers: after each step that was asked for, and every few seconds of playing.
  speak() {
    this.spokenAt = this.clock.now();
    this.get('live').textContent = stepWords(this.step);
  }
}

function describeEpisode() {
  const {agent, episode: which, metrics, oracle} = episode;
  document.getElementById('title').textContent = `${agent}, episode ${which.index}`;
  document.getElementById('about').textContent = `${which.scene}, ${soundWords()}`;
  const badges = [[metrics.success ? 'success' : metrics.stopped ? 'stopped too far away' : 'out of steps', metrics.success ? 'good' : 'bad'],
    [`SPL ${metrics.spl.toFixed(3)}`], [`${metrics.steps} actions, the oracle ${oracle.actions}`], [`${metrics.dtg_m.toFixed(2)} m left`],
    [`${metrics.collisions} collision${metrics.collisions === 1 ? '' : 's'}`], [`reward ${metrics.reward.toFixed(2)}`]];
  if (metrics.success_when_silent) badges.push(['found in silence', 'good']);
  document.querySelector('#legend .other').hidden = episode.sources.every(source => source.goal);
  document.querySelector('#legend .silent').hidden = episode.sources.every(source => source.playing !== null && source.playing[0] <= 1 && source.playing[1] === lastStep);
  for (const [text, kind] of badges) {
    const item = document.createElement('li');
    item.textContent = text;
    if (kind) item.className = kind;
    document.getElementById('badges').append(item);
  }
  for (const {href, text} of episode.links) {
    const link = document.createElement('a');
    link.href = href;
    link.textContent = text;
    document.getElementById('links').append(link);
  }
  document.getElementById('camera-caption').textContent = episode.pictures.depth.length ? 'camera; small: the depth that the agent sees' : 'camera';
  document.getElementById('origin').textContent =
    `The recorded actions were walked again, and gave these numbers. Set ${episode.set_hash}, engine ${episode.engine_hash}.` +
    (episode.policy ? ` Values and probabilities: ${episode.policy}.` : '');
  const log = document.getElementById('log');
  for (let step = 0; step <= lastStep; ++step) {
    const item = document.createElement('li');
    item.textContent = stepWords(step);
    log.append(item);
  }
}

function complain(text) {
  const problem = document.getElementById('problem');
  problem.hidden = false;
  problem.textContent = text;
}

function makeHouse() {
  const note = document.getElementById('no-house');
  try {
    if (typeof THREE === 'undefined') throw new Error('This page was made without three.js: the map shows the way.');
    return new House();
  } catch (error) {
    note.hidden = false;
    note.textContent = typeof THREE === 'undefined' ? error.message : 'This browser has no WebGL: the map shows the way.';
    return null;
  }
}

async function start() {
  describeEpisode();
  const clock = new SoundClock();
  const [picture, pictures, depths] = await Promise.all([
    loadPicture(episode.map.picture), Promise.all(episode.pictures.rgb.map(loadPicture)), Promise.all(episode.pictures.depth.map(loadPicture)),
    clock.load().catch(() => complain('This browser cannot decode FLAC: the episode plays without sound.'))]);
  const player = new Player(clock, new FloorMap(picture), makeHouse(), new Charts(clock.buffer), pictures, depths);
  window.earshotReplay = player;
  // The first picture of the house is the slowest: its programs are compiled for it.
  await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
  document.body.dataset.ready = 'true';
}

start().catch(error => complain(`The page cannot be shown: ${error.message}`));
