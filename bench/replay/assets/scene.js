// Draws a moment of an unpacked episode on canvas: the road from above, and the chart of the whole episode.
"use strict";

const Scene = (() => {
  const INSET = 4; // pixels between a chart's edge and its ends of time

  /** A colour of the style sheet, as it is now: light or dark. */
  function palette() {
    const style = getComputedStyle(document.documentElement);
    const names = ["verge", "road", "mark", "ego", "car", "person", "waiting", "crash", "guard", "ink", "muted", "panel", "line", "speed", "risk", "tc"];
    return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--play-${name}`).trim()]));
  }

  /** Green for the least important body, red for the most. */
  const importanceColour = (share) => `hsl(${Math.round(130 * (1 - share))} 62% 46%)`;

  /** A canvas sized for the device; returns its context in CSS pixels. */
  function prepare(canvas, height) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth || 600;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.height = `${height}px`;
    }
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, width, height };
  }

  const lerp = (values, at) => {
    const last = values.length - 1, low = Math.min(Math.floor(at), last), high = Math.min(low + 1, last);
    return values[low] + (values[high] - values[low]) * (at - low);
  };

  /** The scene: road, bodies, what the guard weighs and changes. */
  function drawScene(canvas, episode, road, at, colours) {
    const narrow = (canvas.clientWidth || 600) < 560, margin = 2.6;
    const view = narrow ? 62 : 112, scale = (canvas.clientWidth || 600) / view;
    const { context: c, width, height } = prepare(canvas, Math.round((2 * road.edge_m + 2 * margin) * scale));
    const time = Math.min(at, episode.steps), centre = lerp(episode.ego.s, time) + (narrow ? 14 : 22);
    const x = (s) => width / 2 + (s - centre) * scale, y = (d) => height / 2 - d * scale;
    const action = Math.max(0, Math.min(Math.ceil(time) - 1, episode.steps - 1));

    c.fillStyle = colours.verge;
    c.fillRect(0, 0, width, height);
    c.fillStyle = colours.road;
    c.fillRect(0, y(road.edge_m), width, 2 * road.edge_m * scale);
    c.strokeStyle = colours.mark;
    c.lineWidth = Math.max(1, 0.14 * scale);
    for (const side of [-1, 1]) line(c, 0, y(side * road.edge_m), width, y(side * road.edge_m));
    c.setLineDash([3 * scale, 6 * scale]);
    c.lineDashOffset = -x(0);
    for (const side of [-0.5, 0.5]) line(c, 0, y(side * road.lane_m), width, y(side * road.lane_m));
    c.setLineDash([]);
    drawGoal(c, x, y, road, scale);
    c.font = `${narrow ? 10 : 11}px system-ui, sans-serif`;
    c.textAlign = "center";
    c.fillStyle = colours.muted;
    for (let mark = Math.ceil((centre - view / 2) / 20) * 20; mark < centre + view / 2; mark += 20)
      c.fillText(`${mark} m`, x(mark), height - 5);

    const weights = bodyWeights(episode, action);
    episode.people.forEach((one, k) => {
      const state = one.state[Math.floor(time)];
      if (state < 2) drawPerson(c, x(lerp(one.s, time)), y(lerp(one.d, time)), scale, road, state === 1, weights(episode.cars.length + k), colours);
    });
    episode.cars.forEach((car, k) =>
      drawCar(c, x(lerp(car.s, time)), y(lerp(car.d, time)), lerp(car.heading, time), scale, road, weights(k), colours));
    drawEgo(c, episode, time, action, x, y, scale, road, colours);
    const share = (k, s, d) => weights(k) && inscribe(c, `${Math.round(100 * weights(k).value)} %`, x(s), y(d), narrow);
    episode.cars.forEach((car, k) => share(k, lerp(car.s, time), lerp(car.d, time)));
    episode.people.forEach((one, k) => one.state[Math.floor(time)] === 1 && share(episode.cars.length + k, lerp(one.s, time), lerp(one.d, time) + 1.9));
  }

  function line(c, x0, y0, x1, y1) {
    c.beginPath();
    c.moveTo(x0, y0);
    c.lineTo(x1, y1);
    c.stroke();
  }

  function drawGoal(c, x, y, road, scale) {
    const cell = (2 * road.edge_m) / 12;
    for (let i = 0; i < 12; i++)
      for (let j = 0; j < 2; j++) {
        c.fillStyle = (i + j) % 2 ? "#111" : "#fff";
        c.fillRect(x(road.goal_m) + j * cell * scale, y(road.edge_m - i * cell), cell * scale, cell * scale);
      }
  }

  /** Importance of each body in a step, with its share of the largest; null where the guard ranks nobody. */
  function bodyWeights(episode, action) {
    const all = episode.guard && episode.guard.importance;
    if (!all || !episode.steps) return () => null;
    const largest = Math.max(...all.map((series) => series[action]));
    return (k) => (all[k][action] > 0 ? { value: all[k][action], share: all[k][action] / largest } : null);
  }

  function box(c, px, py, heading, length, wide) {
    c.save();
    c.translate(px, py);
    c.rotate(-heading);
    c.beginPath();
    c.roundRect(-length / 2, -wide / 2, length, wide, wide * 0.22);
  }

  function drawCar(c, px, py, heading, scale, road, weight, colours) {
    const [length, wide] = road.car_m.map((metres) => metres * scale);
    box(c, px, py, heading, length, wide);
    c.fillStyle = weight ? importanceColour(weight.share) : colours.car;
    c.fill();
    windscreen(c, length, wide);
    c.restore();
  }

  function windscreen(c, length, wide) {
    c.fillStyle = "rgba(10, 20, 30, 0.55)";
    c.fillRect(length * 0.12, -wide * 0.38, length * 0.14, wide * 0.76);
    c.fillRect(-length * 0.36, -wide * 0.34, length * 0.08, wide * 0.68);
  }

  /** Text over a body, legible on any colour. */
  function inscribe(c, text, px, py, narrow) {
    c.font = `700 ${narrow ? 9 : 11}px system-ui, sans-serif`;
    c.lineWidth = 3;
    c.lineJoin = "round";
    c.strokeStyle = "rgba(0, 0, 0, 0.75)";
    c.strokeText(text, px, py + 4);
    c.fillStyle = "#fff";
    c.fillText(text, px, py + 4);
  }

  function label(c, text, px, py, colours) {
    c.font = "600 11px system-ui, sans-serif";
    const half = c.measureText(text).width / 2 + 3;
    c.fillStyle = colours.panel;
    c.globalAlpha = 0.85;
    c.fillRect(px - half, py - 11, 2 * half, 14);
    c.globalAlpha = 1;
    c.fillStyle = colours.ink;
    c.fillText(text, px, py);
  }

  function drawPerson(c, px, py, scale, road, crossing, weight, colours) {
    const side = Math.max(road.pedestrian_m * scale, 5);
    const colour = weight ? importanceColour(weight.share) : crossing ? colours.person : colours.waiting;
    c.fillStyle = colour;
    c.fillRect(px - side / 2, py - side / 2, side, side);
    if (!crossing) return;
    c.strokeStyle = colour;
    c.lineWidth = 2;
    c.beginPath();
    c.arc(px, py, 1.1 * scale, 0, 2 * Math.PI);
    c.stroke();
  }

  function drawEgo(c, episode, time, action, x, y, scale, road, colours) {
    const [length, wide] = road.car_m.map((metres) => metres * scale);
    const s = lerp(episode.ego.s, time), d = lerp(episode.ego.d, time), ended = time >= episode.steps;
    const crashed = ended && (episode.ending === "collision" || episode.ending === "off-road");
    const target = episode.ego.target_d[Math.min(action + 1, episode.steps)];
    c.strokeStyle = colours.ego;
    c.lineWidth = 2;
    c.setLineDash([5, 4]);
    c.beginPath();
    c.moveTo(x(s) + length / 2, y(d));
    c.bezierCurveTo(x(s + 10), y(d), x(s + 10), y(target), x(s + 17), y(target));
    c.stroke();
    c.setLineDash([]);
    const flagged = episode.steps && episode.intervened[action] && time > 0;
    box(c, x(s), y(d), lerp(episode.ego.heading, time), length, wide);
    c.fillStyle = crashed ? colours.crash : colours.ego;
    c.fill();
    windscreen(c, length, wide);
    if (flagged) {
      c.beginPath();
      c.roundRect(-length / 2 - 4, -wide / 2 - 4, length + 8, wide + 8, wide * 0.4);
      c.strokeStyle = colours.guard;
      c.lineWidth = 3;
      c.stroke();
    }
    c.restore();
    if (flagged) label(c, "GUARD", x(s), y(d) - wide * 0.95, colours);
    if (crashed) burst(c, x(s) + length * 0.4, y(d), wide, colours);
  }

  function burst(c, px, py, size, colours) {
    c.strokeStyle = colours.crash;
    c.lineWidth = 3;
    for (let k = 0; k < 8; k++) {
      const turn = (k * Math.PI) / 4 + 0.2;
      line(c, px + Math.cos(turn) * size * 0.7, py + Math.sin(turn) * size * 0.7, px + Math.cos(turn) * size * 1.25, py + Math.sin(turn) * size * 1.25);
    }
  }

  /** Speed, T_c and RQ over the episode, interventions shaded, the present moment marked. */
  function drawChart(canvas, episode, last, at, colours) {
    const { context: c, width, height } = prepare(canvas, 84);
    const left = INSET, right = width - INSET, top = 6, bottom = height - 6;
    const x = (step) => left + ((right - left) * step) / Math.max(last, 1);
    c.fillStyle = colours.panel;
    c.fillRect(0, 0, width, height);
    c.fillStyle = colours.guard;
    c.globalAlpha = 0.3;
    for (let t = 0, from = 0; t < episode.steps; t++) {
      if (!episode.intervened[t]) continue;
      if (!t || !episode.intervened[t - 1]) from = t;
      if (!episode.intervened[t + 1]) c.fillRect(x(from), top, Math.max(1, x(t + 1) - x(from)), bottom - top);
    }
    c.globalAlpha = 1;
    const draw = (values, largest, colour) => {
      c.strokeStyle = colour;
      c.lineWidth = 1.8;
      c.beginPath();
      values.forEach((value, t) => {
        const py = bottom - ((bottom - top) * Math.min(Math.max(value, 0), largest)) / largest;
        if (t) c.lineTo(x(t), py); else c.moveTo(x(t), py);
      });
      c.stroke();
    };
    draw(episode.ego.speed, 14, colours.speed);
    if (episode.guard) {
      if (episode.guard.risk) draw(episode.guard.risk, 100, colours.risk);
      draw(episode.guard.tc, 8, colours.tc);
    }
    if (episode.closest !== null) {
      c.setLineDash([3, 3]);
      c.strokeStyle = colours.muted;
      c.lineWidth = 1;
      line(c, x(episode.closest), top, x(episode.closest), bottom);
      c.setLineDash([]);
    }
    c.strokeStyle = colours.ink;
    c.lineWidth = 2;
    line(c, x(at), 0, x(at), height);
  }

  return { INSET, palette, drawScene, drawChart };
})();
