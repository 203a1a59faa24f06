// What is known over time: what each ear heard, how loud and from where, what it was worth.
'use strict';

const gutter = 92;  // pixels left of the plots, for their names

function colorOf(level) {
  // Dark to bright through purple and orange.
  const stops = [[8, 8, 20], [52, 15, 84], [130, 28, 110], [205, 66, 76], [247, 140, 50], [252, 240, 160]];
  const at = Math.max(0, Math.min(0.9999, level)) * (stops.length - 1), low = Math.floor(at), part = at - low;
  return stops[low].map((value, i) => value + part * (stops[low + 1][i] - value));
}

/// Powers of the frequencies of `size` samples (a power of two), in place.
function powerSpectrum(real, imaginary) {
  const size = real.length;
  for (let i = 1, j = 0; i < size; ++i) {
    let bit = size >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j |= bit;
    if (i < j) [real[i], real[j]] = [real[j], real[i]];
  }
  imaginary.fill(0);
  for (let length = 2; length <= size; length <<= 1) {
    const angle = -2 * Math.PI / length, half = length >> 1;
    for (let k = 0; k < half; ++k) {
      const cos = Math.cos(angle * k), sin = Math.sin(angle * k);
      for (let i = k; i < size; i += length) {
        const j = i + half, re = real[j] * cos - imaginary[j] * sin, im = real[j] * sin + imaginary[j] * cos;
        real[j] = real[i] - re;
        imaginary[j] = imaginary[i] - im;
        real[i] += re;
        imaginary[i] += im;
      }
    }
  }
}

class Charts {
  constructor(buffer) {
    this.rows = document.getElementById('rows');
    this.buffer = buffer;
    this.list = [];
    const ears = buffer ? [buffer.getChannelData(0), buffer.getChannelData(1)] : [];
    ears.forEach((samples, ear) => {
      const name = ear === 0 ? 'left ear' : 'right ear';
      this.add(`${name}`, 58, `Spectrogram of the ${name}, 0 to ${(buffer.sampleRate / 2000).toFixed(0)} kHz`, (context, width, height) => this.drawSpectrogram(context, width, height, samples));
    });
    const steps = episode.steps;
    const loudest = Math.max(...steps.map(step => Math.max(...step.level_db)));
    const levels = ear => steps.map(step => step.level_db[ear] - loudest);
    const quietest = Math.max(-60, Math.min(...levels(0), ...levels(1)));
    this.add('level dB', 56, `Level at the ears, from ${quietest.toFixed(0)} to 0 dB below the loudest step; darker where the goal is silent`, (context, width, height) => {
      const axes = this.axes(context, width, height, Math.min(-6, quietest), 0);
      context.fillStyle = '#07090d';
      steps.forEach((step, i) => !goalPlays(i) && context.fillRect(axes.x(i), 0, axes.x(i + 1) - axes.x(i) + 0.5, height));
      this.line(context, axes, levels(0), '#c084fc');
      this.line(context, axes, levels(1), '#34d399');
    }, [['left', '#c084fc'], ['right', '#34d399']]);
    this.add('direction', 64, 'Direction of the goal: where it is, and where the ears place what they hear', (context, width, height) => {
      const axes = this.axes(context, width, height, -180, 180);
      this.zero(context, axes, 0);
      this.line(context, axes, steps.map(step => step.bearing_deg), '#fb7185', 180);
      context.fillStyle = '#e8ecf3';
      steps.forEach((step, i) => {
        if (step.heard_deg !== null) context.fillRect(axes.x(i + 0.5) - 1.5, axes.y(step.heard_deg) - 1.5, 3, 3);
      });
    }, [['true', '#fb7185'], ['heard', '#e8ecf3']], ['left', 'ahead', 'right']);
    let sum = 0;
    const returns = steps.map(step => sum += step.reward);
    const values = steps.map(step => step.value === undefined ? null : step.value);
    const hasValue = values.some(value => value !== null);
    const known = returns.concat(values.filter(value => value !== null));
    this.add(hasValue ? 'reward, value' : 'reward', 56, `Sum of the rewards, ${sum.toFixed(1)} at the end${hasValue ? ', and the value that the policy expects' : ''}`, (context, width, height) => {
      const axes = this.axes(context, width, height, Math.min(0, ...known), Math.max(1, ...known));
      this.zero(context, axes, 0);
      this.line(context, axes, returns, '#4ade80');
      if (hasValue) this.line(context, axes, values, '#38bdf8');
    }, hasValue ? [['sum of rewards', '#4ade80'], ['value', '#38bdf8']] : [['sum of rewards', '#4ade80']]);
    this.draw();
    new ResizeObserver(() => this.draw()).observe(this.rows);
  }

  add(name, height, label, paint, colors = [], ticks = []) {
    const canvas = document.createElement('canvas');
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', label);
    canvas.style.height = `${height}px`;
    this.rows.append(canvas);
    this.list.push({canvas, name, height, paint, colors, ticks});
  }

  draw() {
    const width = this.rows.clientWidth, ratio = window.devicePixelRatio || 1;
    if (width < gutter + 50 || width === this.width) return;
    this.width = width;
    for (const {canvas, name, height, paint, colors, ticks} of this.list) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      const context = canvas.getContext('2d');
      context.scale(ratio, ratio);
      paint(context, width, height);
      context.font = '12px system-ui, "DejaVu Sans", sans-serif';
      context.textBaseline = 'top';
      context.fillStyle = '#e8ecf3';
      context.fillText(name, 8, 6);
      colors.forEach(([text, color], i) => {
        context.fillStyle = color;
        context.fillText(text, 8, 22 + 14 * i);
      });
      context.font = '10px system-ui, "DejaVu Sans", sans-serif';
      context.fillStyle = '#9aa7ba';
      context.textAlign = 'right';
      ticks.forEach((text, i) => context.fillText(text, gutter - 4, 4 + (height - 20) * i / Math.max(1, ticks.length - 1)));
      context.textAlign = 'left';
    }
  }

  /// Pixels of a time in the rows.
  xOf(time) {
    return gutter + (this.rows.clientWidth - gutter) * time / duration;
  }
  timeOf(x) {
    return duration * (x - gutter) / (this.rows.clientWidth - gutter);
  }

  axes(context, width, height, low, high) {
    const margin = 5;
    return {
      left: gutter, right: width,
      x: step => gutter + (width - gutter) * step * stepTime / duration,
      y: value => height - margin - (height - 2 * margin) * (value - low) / (high - low || 1),
    };
  }

  zero(context, axes, value) {
    context.strokeStyle = '#2a3242';
    context.beginPath();
    context.moveTo(axes.left, axes.y(value));
    context.lineTo(axes.right, axes.y(value));
    context.stroke();
  }

  /// breakAt: a jump further than this is no line.
  line(context, axes, values, color, breakAt = Infinity) {
    context.strokeStyle = color;
    context.lineWidth = 1.7;
    context.beginPath();
    let last = null;
    values.forEach((value, step) => {
      if (value === null) return void (last = null);
      const x = axes.x(step + 0.5), y = axes.y(value);
      if (last === null || Math.abs(value - last) > breakAt) context.moveTo(x, y);
      else context.lineTo(x, y);
      last = value;
    });
    context.stroke();
  }

  drawSpectrogram(context, width, height, samples) {
    const size = 512, columns = Math.min(1400, Math.max(1, Math.floor(samples.length / 64))), bins = size / 2;
    const image = new ImageData(columns, bins);
    const real = new Float32Array(size), imaginary = new Float32Array(size), window = new Float32Array(size);
    for (let i = 0; i < size; ++i) window[i] = 0.5 - 0.5 * Math.cos(2 * Math.PI * i / size);
    for (let column = 0; column < columns; ++column) {
      const middle = Math.round((column + 0.5) * samples.length / columns);
      for (let i = 0; i < size; ++i) real[i] = (samples[middle - bins + i] || 0) * window[i];
      powerSpectrum(real, imaginary);
      for (let bin = 0; bin < bins; ++bin) {
        const decibels = 10 * Math.log10(real[bin] ** 2 + imaginary[bin] ** 2 + 1e-9);
        const [r, g, b] = colorOf((decibels + 50) / 80);
        image.data.set([r, g, b, 255], 4 * ((bins - 1 - bin) * columns + column));
      }
    }
    const picture = new OffscreenCanvas(columns, bins);
    picture.getContext('2d').putImageData(image, 0, 0);
    context.imageSmoothingEnabled = true;
    context.drawImage(picture, gutter, 0, width - gutter, height);
  }
}
