// Packed episodes (bench/replay/packed.py) as arrays in SI units.
"use strict";

const Packed = (() => {
  /** Numbers of a series of second differences, divided by a scale. */
  function unpack(series, scale) {
    const values = new Float64Array(series.length);
    let step = 0, value = 0;
    for (let i = 0; i < series.length; i++) {
      step += series[i];
      value += step;
      values[i] = value / scale;
    }
    return values;
  }

  const each = (series, scales) =>
    Object.fromEntries(Object.entries(series).map(([name, list]) => [name, unpack(list, scales[name] || 100)]));

  /** A packed episode with its series as arrays in SI units. */
  function unpackEpisode(packed) {
    const scales = { heading: 1000, state: 1, risk: 1 };
    const episode = { ...packed, ego: each(packed.ego, scales) };
    episode.cars = packed.cars.map((car) => each(car, scales));
    episode.people = packed.people.map((one) => each(one, scales));
    episode.intervened = unpack(packed.intervened, 1);
    episode.asked_d = unpack(packed.asked_d, 100);
    episode.asked_a = packed.asked_a && unpack(packed.asked_a, 100);
    if (packed.guard) {
      const { importance, ...rest } = packed.guard;
      episode.guard = each(rest, scales);
      episode.guard.importance = importance && importance.map((series) => unpack(series, 100));
    }
    return episode;
  }

  /** Episodes of base64 of deflated JSON. */
  async function inflate(text) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).json();
  }

  return { unpackEpisode, inflate };
})();
