// Plays flights: one clock for the plane, the cursors and the numbers of each player.
(() => {
  const NS = "http://www.w3.org/2000/svg";
  const drawn = (name, parent, properties = {}) => {
    const node = document.createElementNS(NS, name);
    for (const [key, value] of Object.entries(properties)) node.setAttribute(key, value);
    parent.append(node);
    return node;
  };
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  const nice = raw => {
    const power = 10 ** Math.floor(Math.log10(raw));
    return [1, 2, 5, 10].map(m => m * power).find(step => step >= raw * (1 - 1e-9));
  };
  const told = value => String(Number(value.toPrecision(4))).replace("-", "\u2212");

  // The value between two frames; null where either is missing.
  const between = (row, at) => {
    if (row.length === 1) return row[0];
    const place = Math.min(Math.floor(at), row.length - 2);
    const a = row[Math.max(place, 0)], b = row[Math.max(place, 0) + 1];
    if (a === null || b === null) return at === place ? a : null;
    return a + (b - a) * (at - place);
  };

  const plane = (svg, data, frames) => {
    const [net, world, overlay] = svg.querySelectorAll(":scope > g");
    const tracks = [...world.querySelectorAll(".trail")];
    const plans = [...world.querySelectorAll(".plan")];
    const vehicles = [...overlay.querySelectorAll(".vehicle")];
    const numbers = [...overlay.querySelectorAll(".number")];
    const targets = [...overlay.querySelectorAll(".target")];
    const leader = overlay.querySelector(".leader");
    const [bar, barText] = overlay.querySelector(".scale-bar").children;
    const marks = data.marks.map(time => {
      const text = drawn("text", overlay.querySelector(".marks"));
      text.textContent = `${told(time)} s`;
      return text;
    });
    const longest = vehicles.length > 20 ? 40 : frames;
    const size = vehicles.length > 20 ? 0.6 : 1;
    let follows = data.follow, width = 0, height = 0, made = -1;

    const layout = () => {
      width = svg.clientWidth || 600; // A page that is not shown yet has no width.
      height = clamp(width * Math.max(data.height / data.width, 0.42), 200, Math.max(260, 0.7 * innerHeight));
      svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      svg.style.height = `${height}px`;
    };
    const whole = () => Math.min((width - 70) / data.width, (height - 70) / data.height);

    const camera = at => {
      let z = whole(), cx = data.width / 2, cy = data.height / 2;
      if (follows) {
        const xs = data.x.map(row => between(row, at)), ys = data.y.map(row => between(row, at));
        const seen = xs.map((x, k) => [x, ys[k]]).filter(([x, y]) => x !== null && y !== null);
        z = Math.max(z, Math.min(width, height) * 0.8 / data.window);
        if (seen.length) {
          const middle = k => (Math.min(...seen.map(p => p[k])) + Math.max(...seen.map(p => p[k]))) / 2;
          [cx, cy] = [middle(0), middle(1)];
        }
      }
      return { z, x: width / 2 - z * cx, y: height / 2 - z * cy };
    };

    const lines = view => {
      const perUnit = view.z * data.per_unit, step = nice(52 / perUnit);
      const left = data.origin[0] - view.x / perUnit, top = data.origin[1] + view.y / perUnit;
      net.replaceChildren();
      for (let k = Math.ceil(left / step); k * step < left + width / perUnit; k += 1) {
        const x = (k * step - left) * perUnit;
        drawn("path", net, { d: `M${x.toFixed(1)} 0V${height}` });
        if (x > 40 && x < width - 30) drawn("text", net, { x, y: height - 5, "text-anchor": "middle" }).textContent = told(k * step);
      }
      for (let k = Math.floor(top / step); k * step > top - height / perUnit; k -= 1) {
        const y = (top - k * step) * perUnit;
        drawn("path", net, { d: `M0 ${y.toFixed(1)}H${width}` });
        if (y > 20 && y < height - 20) drawn("text", net, { x: 4, y: y + 4 }).textContent = told(k * step);
      }
      const length = step * perUnit, x0 = width - 12 - length;
      bar.setAttribute("d", `M${x0} 12v8m0-4h${length}m0-4v8`);
      barText.setAttribute("x", x0 + length / 2);
      barText.setAttribute("y", 34);
      barText.textContent = `${told(step)} ${data.unit}`;
    };

    const draw = (at, time) => {
      const view = camera(at);
      world.setAttribute("transform", `translate(${view.x.toFixed(2)} ${view.y.toFixed(2)}) scale(${view.z})`);
      lines(view);
      const place = (node, x, y, more = "") => {
        const missing = x === null || y === null;
        node.setAttribute("visibility", missing ? "hidden" : "visible");
        if (!missing) node.setAttribute("transform", `translate(${(view.x + view.z * x).toFixed(2)} ${(view.y + view.z * y).toFixed(2)})${more}`);
      };
      vehicles.forEach((node, k) => {
        const x = between(data.x[k], at), y = between(data.y[k], at);
        const turn = between(data.turn[k], at) ?? 0;
        place(node, x, y, ` rotate(${turn.toFixed(1)}) scale(${size})`);
        // The number stands behind and beside, where the vehicle has been.
        const away = (turn + 215) * Math.PI / 180, far = 17 * size + 2;
        numbers[k].setAttribute("dx", (far * Math.cos(away)).toFixed(1));
        numbers[k].setAttribute("dy", (far * Math.sin(away) + 4).toFixed(1));
        place(numbers[k], x, y);
        const last = Math.floor(at), row = [];
        for (let f = Math.max(0, last - longest); f <= last; f += 1) {
          if (data.x[k][f] !== null && data.y[k][f] !== null) row.push(data.x[k][f], data.y[k][f]);
        }
        if (x !== null && y !== null) row.push(Math.round(x), Math.round(y));
        tracks[k].setAttribute("points", row.join(" "));
      });
      targets.forEach((node, k) => place(node, between(data.targets[k].x, at), between(data.targets[k].y, at)));
      if (leader) place(leader, between(data.leader.x, at), between(data.leader.y, at));
      marks.forEach((node, k) => {
        const then = data.marks[k] / data.end * (frames - 1);
        node.setAttribute("dy", -9);
        place(node, between(data.x[0], then), between(data.y[0], then));
      });
      let now = -1;
      while (now + 1 < data.plans.length && data.plans[now + 1][0] <= time + 1e-9) now += 1;
      if (now !== made) {
        made = now;
        plans.forEach((node, k) => node.setAttribute("points", now < 0 ? "" : (data.plans[now][1][k] ?? []).join(" ")));
      }
    };
    layout();
    return { draw, layout, get follows() { return follows; }, set follows(value) { follows = value; } };
  };

  for (const player of document.querySelectorAll(".player")) {
    const data = JSON.parse(player.querySelector("script").textContent);
    const last = data.frames - 1, [left, right] = data.edges;
    const play = player.querySelector(".play"), scrub = player.querySelector(".scrub input");
    const clock = player.querySelector(".clock"), speed = player.querySelector(".speed");
    const box = player.querySelector(".follow"), svg = player.querySelector(".plane");
    const panels = [...player.querySelectorAll(".panel")];
    let scene = null, time = 0, playing = false, before = 0;
    if (svg) scene = plane(svg, { ...data.plane, end: data.end }, data.frames);

    const valueAt = ({ times, values, held }) => {
      if (!values.length) return "";
      let k = 0;
      while (k + 1 < times.length && times[k + 1] <= time + 1e-9) k += 1;
      k = Math.min(k, values.length - 1);
      let value = values[k];
      if (!held && k + 1 < values.length && value !== null && values[k + 1] !== null) {
        value += (values[k + 1] - value) * (time - times[k]) / (times[k + 1] - times[k]);
      }
      return value === null ? "not finite" : told(value);
    };
    const draw = () => {
      const at = last * time / data.end;
      scrub.value = Math.round(at);
      scrub.setAttribute("aria-valuetext", `${time.toFixed(data.digits)} s of ${data.end.toFixed(data.digits)} s`);
      clock.textContent = time.toFixed(data.digits);
      scene?.draw(at, time);
      panels.forEach((panel, k) => {
        panel.querySelector(".cursor").setAttribute("transform", `translate(${((right - left) * time / data.end).toFixed(2)} 0)`);
        panel.querySelector(".now").textContent = valueAt(data.panels[k]);
      });
    };
    const go = to => { time = clamp(to, 0, data.end); draw(); };
    const stop = () => { playing = false; play.textContent = "Play"; };
    const tick = now => {
      if (!playing) return;
      const next = time + (now - before) / 1000 * Number(speed.value);
      before = now;
      go(next);
      if (next >= data.end) stop();
      else requestAnimationFrame(tick);
    };
    const toggle = () => {
      if (playing) return stop();
      if (time >= data.end) time = 0;
      playing = true;
      play.textContent = "Pause";
      before = performance.now();
      requestAnimationFrame(tick);
    };
    const follow = value => { scene.follows = value; box.checked = value; draw(); };

    play.addEventListener("click", toggle);
    scrub.addEventListener("input", () => go(data.end * scrub.value / last));
    box?.addEventListener("change", () => follow(box.checked));
    player.addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const own = event.target.closest("button, input, select");
      const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: last / 10, PageDown: -last / 10 }[event.key];
      if (event.key === " " && !own) toggle();
      else if (event.key.toLowerCase() === "f" && scene && event.target !== speed) follow(!scene.follows);
      else if (step && !own) go(time + step * data.end / last);
      else if (event.key === "Home" && !own) go(0);
      else if (event.key === "End" && !own) go(data.end);
      else return;
      event.preventDefault();
    });
    panels.forEach(panel => panel.addEventListener("click", event => {
      const frame = panel.getBoundingClientRect(), x = (event.clientX - frame.left) / frame.width * panel.viewBox.baseVal.width;
      go(data.end * (x - left) / (right - left));
    }));
    for (const control of [play, scrub, speed, box]) if (control) control.disabled = false;
    if (scene) {
      box.checked = scene.follows;
      let seen = svg.clientWidth;
      new ResizeObserver(() => {
        if (svg.clientWidth === seen) return;
        seen = svg.clientWidth;
        scene.layout();
        draw();
      }).observe(svg);
    }
    draw();
  }
})();
