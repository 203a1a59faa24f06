// The sound, and the time that everything else on the page follows: that of the sound card.
'use strict';

class SoundClock {
  constructor() {
    this.buffer = null;  // stays null where the browser cannot decode the sound: then the time is the computer's
    this.context = null;
    this.source = null;
    this.playing = false;
    this.offset = 0;  // of the sound, where it was started last
    this.startedAt = 0;
    this.volume = 1;
    this.muted = false;
  }

  async load() {
    const bytes = bytesOf(episode.audio.data);
    const decoder = new OfflineAudioContext(2, 1, episode.audio.sample_rate_hz);
    this.buffer = await decoder.decodeAudioData(bytes.buffer);
  }

  async play() {
    if (this.playing) return;
    if (this.offset >= duration - 1e-3) this.offset = 0;
    if (this.buffer) {
      if (!this.context) {
        this.context = new AudioContext({latencyHint: 'interactive'});
        this.gain = this.context.createGain();
        this.analyser = this.context.createAnalyser();
        this.analyser.fftSize = 4096;
        this.gain.connect(this.context.destination);
      }
      this.applyVolume();
      await this.context.resume();
      this.startSource();
    } else {
      this.startedAt = performance.now() / 1000;
    }
    this.playing = true;
  }

  startSource() {
    this.source = this.context.createBufferSource();
    this.source.buffer = this.buffer;
    this.source.connect(this.analyser);
    this.source.connect(this.gain);
    // A little later than now, so that the first samples are not late and the start is known to the sample.
    this.startedAt = this.context.currentTime + 0.02;
    this.source.start(this.startedAt, this.offset);
  }

  stopSource() {
    if (!this.source) return;
    this.source.stop();
    this.source.disconnect();
    this.source = null;
  }

  pause() {
    if (!this.playing) return;
    this.offset = this.now();
    this.playing = false;
    this.stopSource();
  }

  seek(time) {
    const wanted = Math.max(0, Math.min(duration, time));
    const playing = this.playing;
    if (playing) this.stopSource();
    this.offset = wanted;
    if (!playing) return;
    if (this.buffer) this.startSource();
    else this.startedAt = performance.now() / 1000;
  }

  /// Seconds of the episode that are heard at this moment.
  now() {
    if (!this.playing) return this.offset;
    const latency = this.context ? this.context.outputLatency || this.context.baseLatency || 0 : 0;
    const since = (this.context ? this.context.currentTime - latency : performance.now() / 1000) - this.startedAt;
    return Math.min(duration, this.offset + Math.max(0, since));
  }

  applyVolume() {
    if (this.gain) this.gain.gain.value = this.muted ? 0 : this.volume;
  }
}
