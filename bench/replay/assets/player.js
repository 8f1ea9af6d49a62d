// The replay player: one or two episodes that run together, drawn by scene.js.
"use strict";

const Replays = (() => {
  const MISSING = "none";

  const element = (tag, attributes = {}, ...children) => {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes))
      if (name === "class") made.className = value; else made.setAttribute(name, value);
    made.append(...children);
    return made;
  };

  const number = (value, places, unit) => (value === null || value === undefined ? MISSING : `${value.toFixed(places)} ${unit}`);

  /** One episode's part of the player: title, scene, chart, figures of the moment. */
  class Lane {
    constructor(episode, road) {
      this.episode = episode;
      this.road = road;
      this.scene = element("canvas", { class: "play-scene", role: "img", "aria-label": `Road from above: ${episode.title}, episode ${episode.episode}` });
      this.chart = element("canvas", { class: "play-chart", role: "img", "aria-label": "Speed, T_c and RQ over the episode" });
      this.facts = element("dl", { class: "play-facts" });
      this.cells = new Map();
      const figures = episode.figures;
      const end = episode.ending === "collision" ? `collision (${episode.fault})` : episode.ending;
      const summary = `ended: ${end} after ${figures.time_s.toFixed(1)} s and ${figures.distance_m.toFixed(0)} m, ` +
        `mean ${figures.speed_mps.toFixed(2)} m/s, least TTC ${number(figures.ttc_min_s, 2, "s")}, ` +
        `${figures.interventions} of ${episode.steps} steps flagged by the guard`;
      this.root = element("section", { class: "play-lane" },
        element("h4", { class: "play-title" }, `${episode.title}, episode ${episode.episode}`),
        element("p", { class: "play-note" }, summary + (episode.exact ? "; replayed exactly." : "; replayed to rounding (another processor).")),
        this.scene, this.facts, this.chart, legend(episode));
    }

    draw(at, last, colours) {
      Scene.drawScene(this.scene, this.episode, this.road, at, colours);
      Scene.drawChart(this.chart, this.episode, last, at, colours);
      const e = this.episode, step = Math.min(Math.round(at), e.steps), action = Math.max(0, Math.min(step - 1, e.steps - 1));
      this.fact("position", number(e.ego.s[step], 1, "m"));
      this.fact("speed", number(e.ego.speed[step], 2, "m/s"));
      this.fact("acceleration", number(e.ego.acceleration[step], 2, "m/s²"));
      if (!e.steps || !e.guard) return;
      this.fact("T_c", number(e.guard.tc[action], 2, "s"));
      if (e.guard.risk) this.fact("RQ", number(e.guard.risk[action], 0, "%"));
      if (e.guard.share) this.fact("share of S_safe", number(e.guard.share[action], 2, ""));
      const limit = e.guard.ahead[action];
      this.fact("allowed", limit >= 9.99 ? "free" : `≤ ${limit.toFixed(2)} m/s²`);
      if (e.asked_a) this.fact("asked", number(e.asked_a[action], 2, "m/s²"));
      this.fact("guard", step && e.intervened[action] ? "intervenes" : "lets pass");
    }

    fact(name, text) {
      if (!this.cells.has(name)) {
        const cell = element("dd");
        this.facts.append(element("div", {}, element("dt", {}, name), cell));
        this.cells.set(name, cell);
      }
      if (this.cells.get(name).textContent !== text) this.cells.get(name).textContent = text;
    }
  }

  function legend(episode) {
    const entries = [["speed", "speed, 0 to 14 m/s"]];
    if (episode.guard) entries.push(["tc", "T_c, 0 to 8 s"]);
    if (episode.guard && episode.guard.risk) entries.push(["risk", "RQ, 0 to 100 %"]);
    if (episode.guard) entries.push(["guard", "guard intervenes"]);
    if (episode.guard && episode.guard.importance) entries.push(["importance", "importance, low to high"]);
    return element("ul", { class: "play-legend" }, ...entries.map(([key, text]) =>
      element("li", {}, element("span", { class: `play-key play-key-${key}`, "aria-hidden": "true" }), text)));
  }

  /** Plays episodes that begin together; keyboard: space, arrows, Home, End. */
  class Player {
    constructor(root, packed, road) {
      this.lanes = packed.map((one) => new Lane(Packed.unpackEpisode(one), road));
      this.last = Math.max(...this.lanes.map((lane) => lane.episode.steps));
      this.step_s = road.step_s;
      this.at = 0;
      this.playing = false;
      this.button = element("button", { type: "button", class: "play-button", "aria-label": "Play" }, "▶");
      this.slider = element("input", { type: "range", min: "0", max: String(this.last), step: "1", value: "0", class: "play-slider", "aria-label": "Time in the episode" });
      this.clock = element("output", { class: "play-clock" });
      this.speed = element("select", { class: "play-speed", "aria-label": "Playback speed" },
        ...["0.5", "1", "2", "4"].map((rate) => element("option", { value: rate }, `${rate}×`)));
      this.speed.value = "1";
      const bar = element("div", { class: "play-bar" }, this.button, this.slider, this.clock, this.speed);
      const first = this.lanes[0].episode;
      if (first.closest !== null) {
        const jump = element("button", { type: "button", class: "play-jump" }, "Closest moment");
        jump.addEventListener("click", () => this.seek(Math.max(0, first.closest - 20)));
        bar.append(jump);
      }
      this.root = element("div", { class: "play", tabindex: "0", role: "group", "aria-label": "Replay. Space plays and pauses, arrow keys seek." },
        ...this.lanes.map((lane) => lane.root), bar);
      root.replaceChildren(this.root);
      this.listen();
      this.draw();
    }

    listen() {
      this.button.addEventListener("click", () => this.toggle());
      this.slider.addEventListener("input", () => this.seek(Number(this.slider.value)));
      for (const { chart } of this.lanes)
        chart.addEventListener("click", (event) => this.seek(Math.round((this.last * (event.offsetX - Scene.INSET)) / (chart.clientWidth - 2 * Scene.INSET))));
      this.root.addEventListener("keydown", (event) => {
        if (event.target !== this.root) return;
        const moves = { ArrowLeft: -10, ArrowRight: 10, Home: -Infinity, End: Infinity };
        if (event.key === " ") this.toggle();
        else if (event.key in moves) this.seek(this.at + moves[event.key]);
        else return;
        event.preventDefault();
      });
      this.observer = new ResizeObserver(() => this.draw());
      this.observer.observe(this.root);
      this.dark = window.matchMedia("(prefers-color-scheme: dark)");
      this.redraw = () => this.draw();
      this.dark.addEventListener("change", this.redraw);
    }

    /** Stop for good: the player leaves the page. */
    close() {
      this.pause();
      this.observer.disconnect();
      this.dark.removeEventListener("change", this.redraw);
    }

    toggle() {
      if (this.playing) this.pause(); else this.play();
    }

    play() {
      if (this.at >= this.last) this.at = 0;
      this.playing = true;
      this.face("Pause", "❚❚");
      let before = performance.now();
      const tick = (now) => {
        if (!this.playing) return;
        this.at = Math.min(this.last, this.at + (Math.max(0, now - before) / 1000 / this.step_s) * Number(this.speed.value));
        before = now;
        if (this.at >= this.last) this.pause();
        this.draw();
        requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }

    pause() {
      this.playing = false;
      this.face("Play", "▶");
    }

    face(name, sign) {
      this.button.setAttribute("aria-label", name);
      this.button.textContent = sign;
    }

    seek(step) {
      this.at = Math.min(this.last, Math.max(0, step));
      this.draw();
    }

    draw() {
      const colours = Scene.palette();
      for (const lane of this.lanes) lane.draw(this.at, this.last, colours);
      this.slider.value = String(Math.round(this.at));
      const time = (this.at * this.step_s).toFixed(1), all = (this.last * this.step_s).toFixed(1);
      this.clock.textContent = `${time} / ${all} s`;
      this.slider.setAttribute("aria-valuetext", `${time} of ${all} seconds`);
    }
  }

  return { Player, inflate: Packed.inflate };
})();
