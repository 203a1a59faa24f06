// The house in three dimensions, cut open, by three.js.
'use strict';

/// A band of this width along places, level on the floor; dashes: metres of band and of gap.
function ribbonGeometry(places, width, height, dashes = null) {
  const corners = [], ends = [0];
  let along = 0;
  for (let i = 1; i < places.length; ++i) {
    const [ax, , az] = places[i - 1], [bx, , bz] = places[i], length = Math.hypot(bx - ax, bz - az);
    if (length > 1e-6) {
      const sx = -(bz - az) / length * width / 2, sz = (bx - ax) / length * width / 2;
      const quad = (from, to) => {
        const at = part => [ax + (bx - ax) * part, az + (bz - az) * part];
        const [px, pz] = at(from / length), [qx, qz] = at(to / length);
        corners.push(px - sx, height, pz - sz, px + sx, height, pz + sz, qx - sx, height, qz - sz, qx - sx, height, qz - sz, px + sx, height, pz + sz, qx + sx, height, qz + sz);
      };
      if (!dashes) {
        quad(-0.3 * width, length + 0.3 * width);
      } else {
        const period = dashes[0] + dashes[1];
        for (let t = 0; t < length;) {
          const phase = (along + t) % period;
          const next = Math.min(length, t + (phase < dashes[0] ? dashes[0] - phase : period - phase) + 1e-6);
          if (phase < dashes[0]) quad(t, next);
          t = next;
        }
      }
      along += length;
    }
    ends.push(corners.length / 3);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(new Float32Array(corners), 3));
  return {geometry, ends};
}

class House {
  constructor() {
    this.canvas = document.getElementById('house');
    this.view = 'overview';
    this.quality = 1;
    this.still = false;  // while the episode plays: too slow
    this.turn = 0.55;
    this.tilt = 0.95;
    this.zoom = 1;
    this.renderer = new THREE.WebGLRenderer({canvas: this.canvas, antialias: true, powerPreference: 'low-power'});
    this.renderer.setClearColor(0x161b24);
    this.renderer.localClippingEnabled = true;
    this.floor = episode.floor_m;
    this.cut = new THREE.Plane(new THREE.Vector3(0, -1, 0), this.floor + 1.25);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.05, 500);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x7d8496, 0.66));
    const sun = new THREE.DirectionalLight(0xfff4e0, 0.34);
    sun.position.set(0.5, 1, 0.35);
    this.scene.add(sun);
    this.addMesh();
    this.addPaths();
    this.addSounds();
    this.addAgent();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(this.canvas.parentElement);
    this.resize();
    this.calibrate();
  }

  addMesh() {
    const mesh = episode.mesh, corners = new Uint16Array(bytesOf(mesh.vertices).buffer), indices = new Uint32Array(bytesOf(mesh.triangles).buffer);
    const colors = bytesOf(mesh.colors), count = indices.length;
    const positions = new Float32Array(3 * count), shades = new Float32Array(3 * count);
    for (let i = 0; i < count; ++i)
      for (let axis = 0; axis < 3; ++axis) {
        positions[3 * i + axis] = mesh.low[axis] + mesh.size[axis] * corners[3 * indices[i] + axis] / 65535;
        shades[3 * i + axis] = colors[3 * Math.floor(i / 3) + axis] / 255;
      }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(shades, 3));
    geometry.computeVertexNormals();
    // Of a house of solid walls the back faces that the cut lays open look as the inside of the walls.
    const solid = new THREE.MeshLambertMaterial({vertexColors: THREE.VertexColors, side: THREE.FrontSide, clippingPlanes: [this.cut]});
    const inside = new THREE.MeshBasicMaterial({color: 0x39435a, side: THREE.BackSide, clippingPlanes: [this.cut]});
    this.scene.add(new THREE.Mesh(geometry, solid));
    this.scene.add(this.inside = new THREE.Mesh(geometry, inside));
    const map = episode.map, perPx = map.metres_per_px;
    this.middle = new THREE.Vector3(map.low[0] + perPx * map.width_px / 2, this.floor + 0.5, map.low[1] + perPx * map.height_px / 2);
    this.extent = [perPx * map.width_px, perPx * map.height_px];
  }

  ribbon(places, width, height, color, dashes = null) {
    const {geometry, ends} = ribbonGeometry(places, width, this.floor + height, dashes);
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({color, side: THREE.DoubleSide}));
    this.scene.add(mesh);
    return {mesh, ends};
  }

  addPaths() {
    this.ribbon(episode.oracle.places, 0.07, 0.03, 0xfbbf24, [0.22, 0.14]);
    this.trail = this.ribbon(episode.steps.map(step => step.position), 0.09, 0.045, 0x38bdf8);
  }

  addSounds() {
    this.sounds = episode.sources.map(source => {
      const color = source.goal ? 0xfb7185 : 0xa78bfa;
      const ball = new THREE.Mesh(new THREE.SphereBufferGeometry(0.13, 24, 16), new THREE.MeshBasicMaterial({color}));
      const pole = new THREE.Mesh(new THREE.CylinderBufferGeometry(0.012, 0.012, episode.source_height_m, 6), new THREE.MeshBasicMaterial({color}));
      const rings = [0, 1, 2].map(() => {
        const ring = new THREE.Mesh(new THREE.RingBufferGeometry(0.94, 1, 64), new THREE.MeshBasicMaterial({color, transparent: true, side: THREE.DoubleSide, depthWrite: false}));
        ring.rotation.x = -Math.PI / 2;
        this.scene.add(ring);
        return ring;
      });
      this.scene.add(ball, pole);
      return {source, ball, pole, rings};
    });
    for (const goal of episode.goals) {
      const radius = episode.success_radius_m;
      const disc = new THREE.Mesh(new THREE.RingBufferGeometry(radius - 0.05, radius, 64), new THREE.MeshBasicMaterial({color: 0xfb7185, side: THREE.DoubleSide}));
      disc.rotation.x = -Math.PI / 2;
      disc.position.set(goal[0], this.floor + 0.025, goal[2]);
      this.scene.add(disc);
    }
  }

  addAgent() {
    this.agent = new THREE.Group();
    const paint = color => new THREE.MeshLambertMaterial({color});
    const add = (geometry, material, x, y, z) => {
      const mesh = new THREE.Mesh(geometry, material);
      mesh.position.set(x, y, z);
      this.agent.add(mesh);
      return mesh;
    };
    add(new THREE.CylinderBufferGeometry(0.13, 0.17, 0.8, 24), paint(0x38bdf8), 0, 0.45, 0);
    add(new THREE.SphereBufferGeometry(0.17, 24, 18), paint(0xe8f6ff), 0, 1.02, 0);
    add(new THREE.SphereBufferGeometry(0.065, 14, 10), paint(0xc084fc), -0.17, 1.03, 0);  // left ear, right ear: the colours of the levels
    add(new THREE.SphereBufferGeometry(0.065, 14, 10), paint(0x34d399), 0.17, 1.03, 0);
    const nose = add(new THREE.ConeBufferGeometry(0.06, 0.16, 14), paint(0x0ea5e9), 0, 1.02, -0.2);
    nose.rotation.x = -Math.PI / 2;
    const half = episode.fov_deg * Math.PI / 360;
    const fan = new THREE.Mesh(new THREE.CircleBufferGeometry(1.4, 32, Math.PI / 2 - half, 2 * half),
      new THREE.MeshBasicMaterial({color: 0x38bdf8, transparent: true, opacity: 0.22, side: THREE.DoubleSide, depthWrite: false}));
    fan.rotation.x = -Math.PI / 2;
    fan.position.y = 0.06;
    this.agent.add(fan);
    this.scene.add(this.agent);
  }

  listen() {
    let last = null;
    this.canvas.addEventListener('pointerdown', event => {
      last = [event.clientX, event.clientY];
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener('pointermove', event => {
      if (!last) return;
      this.turn -= (event.clientX - last[0]) * 0.008;
      this.tilt = Math.max(0.15, Math.min(1.55, this.tilt + (event.clientY - last[1]) * 0.006));
      last = [event.clientX, event.clientY];
      this.redraw();
    });
    this.canvas.addEventListener('pointerup', () => last = null);
    this.canvas.addEventListener('wheel', event => {
      event.preventDefault();
      this.zoom = Math.max(0.25, Math.min(3, this.zoom * Math.exp(event.deltaY * 0.001)));
      this.redraw();
    }, {passive: false});
  }

  resize() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1) * this.quality);
    this.renderer.setSize(box.width, box.height, false);
    this.camera.aspect = box.width / Math.max(1, box.height);
    this.camera.updateProjectionMatrix();
    this.redraw();
  }

  /// Milliseconds of one picture, waited for.
  cost() {
    const gl = this.renderer.getContext(), pixel = new Uint8Array(4), start = performance.now();
    this.draw(0, 0, true);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - start;
  }

  /// As many pixels as the computer draws in a third of the time that picture and map may be behind the sound; where none are few enough, the
  /// house stands still while the episode plays.
  calibrate() {
    this.cost();  // compiles the programs
    let took = this.cost();
    while (took > 13 && this.quality > 0.35) this.lowerQuality(), took = this.cost();
    this.still = took > 26;
    if (!this.still) return;
    this.quality = 1;  // of pictures that nothing waits for
    this.resize();
  }

  lowerQuality() {
    if (this.quality > 0.35) {
      this.quality *= 0.7;
      this.resize();
    } else {
      this.still = true;
    }
  }

  drawFrame(time, step, calm) {
    if (!this.still) this.draw(time, step, calm);
  }

  choose(view) {
    this.view = view;
    this.redraw();
  }

  redraw() {
    if (this.last) this.draw(...this.last);
  }

  placeCamera(pose) {
    const ahead = [-Math.sin(pose.heading), -Math.cos(pose.heading)], [x, y, z] = pose.position, camera = this.camera;
    this.cut.constant = this.view === 'eyes' ? 1e6 : this.floor + 1.25;
    this.agent.visible = this.view !== 'eyes';
    if (this.view === 'eyes') {
      const vertical = 2 * Math.atan(Math.tan(episode.fov_deg * Math.PI / 360) / camera.aspect);
      camera.fov = vertical * 180 / Math.PI;
      camera.position.set(x, y + episode.camera_height_m, z);
      camera.lookAt(x + ahead[0], y + episode.camera_height_m, z + ahead[1]);
    } else if (this.view === 'follow') {
      camera.fov = 50;
      camera.position.set(x - 2.6 * this.zoom * ahead[0], y + 3.1 * this.zoom, z - 2.6 * this.zoom * ahead[1]);
      camera.lookAt(x + 0.8 * ahead[0], y + 0.5, z + 0.8 * ahead[1]);
    } else {
      camera.fov = 36;
      // So far away that the whole storey fits, whichever way it is turned.
      const along = Math.abs(Math.sin(this.turn)), across = Math.abs(Math.cos(this.turn)), [width, depth] = this.extent;
      const wide = width * across + depth * along, deep = (width * along + depth * across) * Math.sin(this.tilt) + 1.25 * Math.cos(this.tilt);
      const tangent = Math.tan(camera.fov * Math.PI / 360);
      const distance = this.zoom * (Math.max(wide / camera.aspect, deep) / (2 * tangent) + 0.2 * deep);
      camera.position.set(
        this.middle.x + distance * Math.cos(this.tilt) * Math.sin(this.turn), this.middle.y + distance * Math.sin(this.tilt),
        this.middle.z + distance * Math.cos(this.tilt) * Math.cos(this.turn));
      camera.lookAt(this.middle);
    }
    camera.updateProjectionMatrix();
  }

  draw(time, step, calm) {
    this.last = [time, step, calm];
    const pose = poseAt(time, calm);
    this.agent.position.set(...pose.position);
    this.agent.rotation.y = pose.heading;
    this.trail.mesh.geometry.setDrawRange(0, this.trail.ends[step]);
    const loudest = Math.max(...episode.steps[step].level_db), loudness = Math.max(0, Math.min(1, 1 + (loudest - this.loudest()) / 40));
    this.sounds.forEach(({source, ball, pole, rings}) => {
      const [x, y, z] = sourcePlace(source, step);
      ball.position.set(x, y + episode.source_height_m, z);
      pole.position.set(x, y + episode.source_height_m / 2, z);
      const heard = plays(source, step);
      ball.material.wireframe = !heard;
      rings.forEach((ring, i) => {
        const phase = (time * 0.8 + i / 3) % 1;
        ring.visible = !calm && heard;
        ring.position.set(x, this.floor + 0.05, z);
        ring.scale.setScalar(0.15 + 1.6 * phase);
        ring.material.opacity = 0.7 * (1 - phase) * (0.25 + 0.75 * loudness);
      });
    });
    this.placeCamera(pose);
    this.renderer.render(this.scene, this.camera);
    this.canvas.dataset.step = step;
  }

  loudest() {
    if (this.loudestDb === undefined) this.loudestDb = Math.max(...episode.steps.map(step => Math.max(...step.level_db)));
    return this.loudestDb;
  }
}
