// The episode that the page holds, its numbers unpacked, and its steps in words.
'use strict';

function bytesOf(base64) {
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return bytes;
}

const episode = JSON.parse(document.getElementById('episode').textContent);
const lastStep = episode.steps.length - 1;
const stepTime = episode.step_time_s;
/// Of the sound: every observation has one step of it.
const duration = episode.audio.samples / episode.audio.sample_rate_hz;

/// The observation whose sound plays at a time: picture, map and words are of this one.
function stepAt(time) {
  return Math.max(0, Math.min(lastStep, Math.floor(time / stepTime + 1e-6)));
}

/// Where the agent is at a time, moving through each step; calm: it jumps from one to the next.
function poseAt(time, calm) {
  const step = stepAt(time), now = episode.steps[step], last = episode.steps[Math.max(0, step - 1)];
  const part = calm ? 1 : Math.max(0, Math.min(1, time / stepTime - step));
  let turn = (now.heading_deg - last.heading_deg) % 360;
  if (turn > 180) turn -= 360;
  if (turn < -180) turn += 360;
  return {
    position: now.position.map((value, axis) => last.position[axis] + part * (value - last.position[axis])),
    heading: (last.heading_deg + part * turn) * Math.PI / 180,
  };
}

const actionWords = ['stopped', 'went forward', 'turned left', 'turned right'];

function directionWords(degrees) {
  const angle = Math.round(Math.abs(degrees));
  if (angle < 3) return 'straight ahead';
  if (angle > 177) return 'straight behind';
  return `${angle} degree${angle === 1 ? '' : 's'} ${degrees > 0 ? 'left' : 'right'}`;
}

/// Whether a source plays by itself in the sound of a step; the house may still give back what it played before.
function plays(source, step) {
  return source.playing !== null && source.playing[0] <= step && step <= source.playing[1];
}

function goalPlays(step) {
  return episode.sources.some(source => source.goal && plays(source, step));
}

/// "step 12, turned left, sound 40 degrees right, 3.2 m"; where the goal makes no sound, "silence, goal 40 degrees right".
function stepWords(step) {
  const now = episode.steps[step];
  let done = step === 0 ? 'at the start' : actionWords[now.action];
  if (now.collided) done += ' and met an obstacle';
  let words = `step ${step}, ${done}, ${goalPlays(step) ? 'sound' : 'silence, goal'} ${directionWords(now.bearing_deg)}, ${now.straight_m.toFixed(1)} m`;
  if (step === lastStep) words += episode.metrics.success ? ', the end: success' : episode.metrics.stopped ? ', the end: too far from the goal' : ', the end: out of steps';
  return words;
}

/// "synth:bird:3", and what else there is to hear: "synth:bird:3, from 1.2 to 9.0 s; beside it synth:music:1".
function soundWords() {
  const name = source => {
    if (source.playing === null) return `${source.sound}, not within the episode`;
    const [first, last] = source.playing, begins = first > 1, ends = last < lastStep;
    const from = ((first - 1) * stepTime).toFixed(1), to = (last * stepTime).toFixed(1);
    return source.sound + (begins && ends ? `, from ${from} to ${to} s` : begins ? `, from ${from} s on` : ends ? `, until ${to} s` : '');
  };
  const goals = episode.sources.filter(source => source.goal), others = episode.sources.filter(source => !source.goal);
  return goals.map(name).join('; ') + (others.length ? `; beside it ${others.map(name).join('; ')}` : '');
}

function sourcePlace(source, step) {
  return source.places[Math.min(step, source.places.length - 1)];
}

const calmQuery = window.matchMedia('(prefers-reduced-motion: reduce)');
