// The storey from above: paths, the sound, the agent and what it faces.
'use strict';

class FloorMap {
  constructor(picture) {
    this.canvas = document.getElementById('map');
    this.context = this.canvas.getContext('2d', {willReadFrequently: true});  // drawn by the processor, which is never late
    this.picture = picture;
    this.base = null;  // what does not change between steps
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.resize();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1, box = this.canvas.getBoundingClientRect();
    if (box.width < 2 || box.height < 2) return;
    this.canvas.width = Math.round(box.width * ratio);
    this.canvas.height = Math.round(box.height * ratio);
    const map = episode.map, perPx = map.metres_per_px;
    this.scale = Math.min(this.canvas.width / map.width_px, this.canvas.height / map.height_px) / perPx;  // pixels of the canvas per metre
    this.left = (this.canvas.width - this.scale * perPx * map.width_px) / 2;
    this.top = (this.canvas.height - this.scale * perPx * map.height_px) / 2;
    this.ratio = ratio;
    this.base = null;
    if (this.last) this.draw(...this.last);
  }

  at(place) {
    return [this.left + this.scale * (place[0] - episode.map.low[0]), this.top + this.scale * (place[2] - episode.map.low[1])];
  }

  path(context, places, color, width, dash = []) {
    context.strokeStyle = color;
    context.lineWidth = width * this.ratio;
    context.lineJoin = context.lineCap = 'round';
    context.setLineDash(dash.map(length => length * this.ratio));
    context.beginPath();
    places.forEach(place => context.lineTo(...this.at(place)));
    context.stroke();
    context.setLineDash([]);
  }

  makeBase() {
    const base = document.createElement('canvas');
    base.width = this.canvas.width;
    base.height = this.canvas.height;
    const context = base.getContext('2d', {willReadFrequently: true}), map = episode.map;
    context.fillStyle = '#0e1117';
    context.fillRect(0, 0, base.width, base.height);
    context.globalAlpha = 0.85;
    context.drawImage(this.picture, this.left, this.top, this.scale * map.metres_per_px * map.width_px, this.scale * map.metres_per_px * map.height_px);
    context.globalAlpha = 1;
    this.path(context, episode.oracle.places, '#00000080', 5);
    this.path(context, episode.oracle.places, '#fbbf24', 2.5, [6, 5]);
    for (const goal of episode.goals) {
      context.beginPath();
      context.arc(...this.at(goal), this.scale * episode.success_radius_m, 0, 2 * Math.PI);
      context.fillStyle = '#fb718522';
      context.fill();
      context.strokeStyle = '#fb7185';
      context.lineWidth = 1.5 * this.ratio;
      context.stroke();
    }
    this.base = base;
  }

  /// step: the observation that the map shows.
  draw(time, step, calm) {
    this.last = [time, step, calm];
    if (!this.canvas.width || !this.scale) return;
    if (!this.base) this.makeBase();
    const context = this.context, pose = poseAt(time, calm);
    context.drawImage(this.base, 0, 0);
    const places = episode.steps.slice(0, step).map(entry => entry.position).concat([pose.position]);
    this.path(context, places, '#00000080', 6);
    this.path(context, places, '#38bdf8', 3);
    episode.sources.forEach(source => {
      const [x, y] = this.at(sourcePlace(source, step));
      context.beginPath();
      context.arc(x, y, 5 * this.ratio, 0, 2 * Math.PI);
      const color = source.goal ? '#fb7185' : '#a78bfa', heard = plays(source, step);
      context.fillStyle = heard ? color : '#0e1117';
      context.fill();
      context.strokeStyle = heard ? '#fff' : color;
      context.lineWidth = (heard ? 1.5 : 2.5) * this.ratio;
      context.stroke();
    });
    const [x, y] = this.at(pose.position), half = episode.fov_deg * Math.PI / 360, ahead = -Math.PI / 2 - pose.heading;
    context.beginPath();
    context.moveTo(x, y);
    context.arc(x, y, 1.4 * this.scale, ahead - half, ahead + half);
    context.closePath();
    context.fillStyle = '#38bdf830';
    context.fill();
    context.save();
    context.translate(x, y);
    context.rotate(ahead + Math.PI / 2);
    const size = 8 * this.ratio;
    context.beginPath();
    context.moveTo(0, -1.3 * size);
    context.lineTo(0.85 * size, 0.9 * size);
    context.lineTo(0, 0.45 * size);
    context.lineTo(-0.85 * size, 0.9 * size);
    context.closePath();
    context.fillStyle = '#38bdf8';
    context.fill();
    context.strokeStyle = '#fff';
    context.lineWidth = 1.5 * this.ratio;
    context.stroke();
    context.restore();
    this.canvas.dataset.step = step;
  }
}
