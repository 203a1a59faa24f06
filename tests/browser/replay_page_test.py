# SPDX-License-Identifier: Apache-2.0
"""A page of `earshot replay --html` in headless Chromium, opened from disk: it plays, picture, map, house and sound keep step, the keyboard
works, screen readers get each step in words, and the console stays empty.

  replay_page_test.py EARSHOT [--page FILE] [--screenshot FILE]

Needs Debian's chromium, chromium-driver and python3-selenium; ends with 77 (skipped) where one is missing.
"""
import re
import statistics
import time

from headless import accessible, check_console_and_requests, opened_page, page_options, press, run, wait_for

IN_STEP_S = 0.040  # by which picture, map and house may follow the sound
SLACK_S = 0.012    # the clock of the sound card goes in blocks

# Notes when each part of the page shows which step, by the clock that the sound keeps, and what is being played.
WATCH = """
const log = window.watched = {shown: [], frames: [], heard: []};
const player = window.earshotReplay, clock = player.clock;
for (const id of ['camera', 'map', 'house']) {
  const canvas = document.getElementById(id);
  let last = canvas.dataset.step;
  new MutationObserver(() => {
    if (canvas.dataset.step === last || !clock.playing) return;
    last = canvas.dataset.step;
    log.shown.push([id, Number(last), clock.now()]);
  }).observe(canvas, {attributes: true, attributeFilter: ['data-step']});
}
let before = null;
const frame = () => {
  if (clock.playing) {
    const now = clock.now();
    if (before !== null) log.frames.push([before, now]);
    before = now;
  }
  requestAnimationFrame(frame);
};
frame();
setInterval(() => {
  if (!clock.playing || !clock.analyser) return;
  const samples = new Float32Array(clock.analyser.fftSize);
  clock.analyser.getFloatTimeDomainData(samples);
  const rendered = clock.offset + clock.context.currentTime - clock.startedAt;
  if (rendered > 0.3) log.heard.push([rendered, clock.context.sampleRate, samples]);
}, 200);
"""

# Where in the sound each piece lies that was caught on its way to the ears: the best match within 80 ms of where the clock says.
LOCATE = """
const rate = window.earshotReplay.clock.buffer.sampleRate, sound = window.earshotReplay.clock.buffer.getChannelData(0);
const other = window.earshotReplay.clock.buffer.getChannelData(1);
return window.watched.heard.slice(0, 12).map(([end, captured, samples]) => {
  const count = Math.floor(samples.length * rate / captured) - 2, piece = new Float32Array(count);
  let energy = 0;
  for (let i = 0; i < count; ++i) {
    const at = samples.length - 1 - (count - 1 - i) * captured / rate, low = Math.floor(at);
    piece[i] = samples[low] + (at - low) * ((samples[low + 1] || samples[low]) - samples[low]);
    energy += piece[i] ** 2;
  }
  if (energy < 1e-6) return null;
  let best = -1, offset = 0;
  for (let shift = -Math.round(0.08 * rate); shift <= 0.08 * rate; ++shift) {
    const first = Math.round(end * rate) - count + shift;
    let product = 0, norm = 1e-12;
    for (let i = 0; i < count; i += 2) {
      const value = 0.5 * ((sound[first + i] || 0) + (other[first + i] || 0));
      product += value * piece[i];
      norm += value * value;
    }
    const match = product / Math.sqrt(norm * energy / 2);
    if (match > best) { best = match; offset = shift / rate; }
  }
  return [offset, best];
});
"""


def make_page(earshot, folder):
    """An episode of the greedy baseline in a house, with a sound that does not repeat within a fraction of a second."""
    episodes, result, page = folder / "set.json", folder / "result.json", folder / "page.html"
    run(earshot, "dataset", "episodes", "house:7,rooms=3,area_m2=36", "--count", "2", "--sounds", "synth:speech:3", "--seed", "5", "--out", episodes)
    run(earshot, "eval", "oracle", "--episodes", episodes, "--out", result)
    print(run(earshot, "replay", result, "--episode", "worst", "--html", page, "--link", "index.html=leaderboard").strip())
    return page


def check_in_step(browser):
    step_s, shown, frames = browser.execute_script("return [stepTime, watched.shown, watched.frames]")
    # Where the computer is too slow for the house, as one without a GPU may be, it stands still while the episode plays.
    house = browser.execute_script("return earshotReplay.house !== null && !earshotReplay.house.still")
    if not house:
        print("house: stands still here while the episode plays")
    late = {}
    for name, step, heard in shown:
        late.setdefault(name, []).append((heard - step * step_s, step, heard))
    for name in ("camera", "map") + (("house",) if house else ()):
        assert len(late.get(name, [])) >= 5, f"{name} showed {len(late.get(name, []))} steps"
        values = sorted(1000 * value for value, _, _ in late[name])
        print(f"{name:7} behind the sound: median {statistics.median(values):.1f} ms, 95 % {values[int(0.95 * (len(values) - 1))]:.1f} ms, "
              f"most {values[-1]:.1f} ms over {len(values)} steps")
    # A machine with other work draws fewer frames: then the first frame after a step is due must show it.
    for name, all_steps in late.items():
        if name == "house" and not house:
            continue
        for value, step, heard in all_steps:
            between = sum(1 for start, _ in frames if step * step_s + SLACK_S < start < heard - 0.001)
            assert value >= -0.002 and (value <= IN_STEP_S or between <= 1), f"{name} shows step {step} {1000 * value:.1f} ms after it is heard, {between} frames late"
    lengths = sorted(1000 * (after - before) for before, after in frames)
    print(f"frames: median {statistics.median(lengths):.1f} ms, most {lengths[-1]:.1f} ms")
    found = [entry for entry in browser.execute_script(LOCATE) if entry and entry[1] > 0.9]
    assert found, "none of the sound that was played is that of the episode"
    print(f"sound: what is played lies within {1000 * max(abs(offset) for offset, _ in found):.1f} ms of where the clock says, in {len(found)} pieces")
    assert max(abs(offset) for offset, _ in found) <= IN_STEP_S


def check_keyboard(browser, last):
    from selenium.webdriver.common.keys import Keys
    step = lambda: int(browser.execute_script("return document.getElementById('camera').dataset.step"))
    live = lambda: browser.execute_script("return document.getElementById('live').textContent")
    words = re.compile(r"^step (\d+), (at the start|stopped|went forward|turned left|turned right)( and met an obstacle)?, "
                       r"(sound|silence, goal) (straight ahead|straight behind|\d+ degrees? (left|right)), \d+\.\d m(, the end: .+)?$")
    expected = [((Keys.HOME,), 0), ((Keys.ARROW_RIGHT,), 1), ((Keys.ARROW_RIGHT,), 2), ((Keys.ARROW_LEFT,), 1),
                ((Keys.SHIFT, Keys.ARROW_RIGHT), min(11, last)), ((Keys.END,), last), ((Keys.ARROW_RIGHT,), last), ((Keys.SHIFT, Keys.ARROW_LEFT), max(0, last - 10))]
    for keys, wanted in expected:
        press(browser, *keys)
        assert step() == wanted, f"step {step()} after {keys}, not {wanted}"
        match = words.match(live())
        assert match and int(match[1]) == wanted, live()
    print(f"screen reader: '{live()}'")
    slider = browser.execute_script("return document.getElementById('step').getAttribute('aria-valuetext')")
    assert slider == live()
    for key, view in (("2", "follow"), ("3", "eyes"), ("1", "overview")):
        press(browser, key)
        pressed = browser.execute_script("return [...document.querySelectorAll('[data-view][aria-pressed=true]')].map(b => b.dataset.view)")
        assert pressed == [view], pressed
    steps = browser.execute_script("return document.querySelectorAll('#log li').length")
    assert steps == last + 1


def check_accessible_tree(browser, last):
    """Landmarks, headings, controls with names and states, pictures with names, and every step as text."""
    tree = accessible(browser)
    named = lambda *roles: [name for role, name, _ in tree if role in roles]
    assert len(named("heading")) >= 1 and all(named("heading")), named("heading")
    assert len(named("main")) == 1 and len(named("banner")) == 1 and named("navigation") == ["Other pages"], sorted({role for role, _, _ in tree})
    for wanted in ("House", "What the agent sees, and where it is", "Player", "Over time"):
        assert wanted in named("region"), named("region")
    for wanted in ("Play", "One step back", "One step on", "Overview 1", "Follow 2", "Eyes 3"):
        assert wanted in named("button"), named("button")
    sliders = {name: properties for role, name, properties in tree if role == "slider"}
    assert {"Step", "volume"} <= set(sliders), sliders
    images = named("img", "image")
    for wanted in ("Map from above", "Colours from the agent's camera, for people", "Spectrogram of the left ear", "Spectrogram of the right ear", "Level at the ears", "Direction of the goal",
                   "Sum of the rewards"):
        assert any(name.startswith(wanted) for name in images), images
    parts = [(role, name) for role, name, _ in tree if role in ("button", "slider", "img", "image", "region", "link", "heading")]
    assert all(name for _, name in parts), parts
    assert any(role == "status" for role, _, _ in tree), "no live region for the steps"
    pressed = [properties.get("pressed") for role, name, properties in tree if role == "button" and name.startswith("Overview")]
    assert pressed == ["true"], pressed
    browser.execute_script("document.querySelector('details').open = true")
    items = [name for role, name, _ in accessible(browser) if role == "listitem"]
    assert len(browser.find_elements("css selector", "#log li")) == last + 1 and len(items) > last
    browser.execute_script("document.querySelector('details').open = false")
    roles = {}
    for role, _, _ in tree:
        roles[role] = roles.get(role, 0) + 1
    print("screen reader gets: " + ", ".join(f"{roles[role]} {role}" for role in ("banner", "main", "navigation", "region", "heading", "button", "slider", "image", "list", "status") if role in roles))


def check_tab_order(browser):
    """The keyboard alone reaches every control, in the order of the page, and sees where it is."""
    from selenium.webdriver.common.keys import Keys
    browser.execute_script("document.activeElement.blur(); window.scrollTo(0, 0)")
    seen = []
    for _ in range(12):
        press(browser, Keys.TAB)
        name, outline = browser.execute_script("const e = document.activeElement; return [e.getAttribute('aria-label') || e.id || e.dataset.view || e.textContent.trim() || e.tagName, getComputedStyle(e).outlineStyle]")
        assert outline != "none", f"{name} has the focus, and does not show it"
        seen.append(name)
        if name == "Every step in words":
            break
    wanted = [name for name in seen if name in ("overview", "follow", "eyes", "Play", "One step back", "One step on", "Step", "volume", "Every step in words")]
    assert wanted == ["overview", "follow", "eyes", "Play", "One step back", "One step on", "Step", "volume", "Every step in words"], seen
    browser.execute_script("document.activeElement.blur()")


def check_silence(browser, earshot, folder):
    """An episode whose goal begins late and falls silent while another sound plays on: words, map and legend tell them apart."""
    episodes, result, page = folder / "silent_set.json", folder / "silent.json", folder / "silent.html"
    scenario = [part for key, value in (("onset_low_s", 1), ("onset_high_s", 1.5), ("duration_mean_s", 1.5), ("distractors", 1)) for part in ("--set", f"data.train.scenario.{key}={value}")]
    run(earshot, "dataset", "episodes", "house:7,rooms=3,area_m2=36", "--count", "2", "--set", "data.train.sounds=[\"synth:speech:3\", \"synth:music:1\"]", "--seed", "6", *scenario, "--out", episodes)
    run(earshot, "eval", "oracle", "--episodes", episodes, "--out", result)
    run(earshot, "replay", result, "--episode", "worst", "--html", page)
    browser.get(page.resolve().as_uri())
    wait_for(browser, "return document.body.dataset.ready === 'true'")
    words = browser.execute_script("return [...document.querySelectorAll('#log li')].map(item => item.textContent)")
    heard = ["silence, goal" not in line for line in words]
    first, last = browser.execute_script("return episode.sources.find(source => source.goal).playing")
    assert heard == [first <= step <= last for step in range(len(words))], words
    assert 7 <= first <= 11 and 9 <= last - first <= 12 and last < len(words) - 1, (first, last, len(words))
    other = browser.execute_script("return episode.sources.find(source => !source.goal).playing")
    assert other[0] <= 1 and other[1] == len(words) - 1, other
    for step, loud in ((0, False), ((first + last) // 2, True), (len(words) - 1, False)):
        center = browser.execute_script(f"""
          earshotReplay.goTo({step});
          const map = earshotReplay.map, at = map.at(sourcePlace(episode.sources.find(source => source.goal), {step}));
          return [...map.context.getImageData(Math.round(at[0]), Math.round(at[1]), 1, 1).data];""")
        assert (center[0] > 200) == loud, f"step {step}: the goal on the map is {center}, and it {'plays' if loud else 'is silent'}"
    shown = browser.execute_script("return ['.goal', '.other', '.silent'].map(name => !document.querySelector('#legend ' + name).hidden)")
    assert shown == [True, True, True], shown
    assert browser.execute_script("return episode.metrics.success_when_silent") == 1
    badges = browser.execute_script("return [...document.querySelectorAll('#badges li')].map(item => item.textContent)")
    assert "success" in badges and "found in silence" in badges, badges
    print(f"silence: goal heard in steps {first} to {last} of {len(words) - 1}; '{words[-1]}'")


def check_reduced_motion(browser):
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]})
    assert browser.execute_script("return calmQuery.matches")
    # The agent stands where the step ends, whatever the time within it, and nothing moves by itself.
    places = browser.execute_script("return [poseAt(2.1 * stepTime, true), poseAt(2.9 * stepTime, true)].map(JSON.stringify)")
    assert places[0] == places[1]
    rings = browser.execute_script("earshotReplay.seek(1.5 * stepTime); return earshotReplay.house ? earshotReplay.house.sounds.flatMap(s => s.rings.map(r => r.visible)) : []")
    assert not any(rings), rings
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def main():
    options = page_options(__doc__)
    with opened_page(options, make_page) as (browser, page, folder):
        size = page.stat().st_size
        wait_for(browser, "return document.body.dataset.ready === 'true' || !document.getElementById('problem').hidden")
        assert browser.execute_script("return document.getElementById('problem').hidden"), browser.execute_script("return document.getElementById('problem').textContent")
        last = browser.execute_script("return lastStep")
        print(f"page: {size / 1e6:.2f} MB for {last} steps")
        assert size <= 5e6 * max(1, last / 100)
        browser.execute_script(WATCH)
        press(browser, " ")
        wait_for(browser, "return earshotReplay.clock.playing")
        wait_for(browser, f"return earshotReplay.step >= {min(last, 40)} || !earshotReplay.clock.playing")
        if browser.execute_script("return earshotReplay.clock.playing"):
            press(browser, " ")
        wait_for(browser, "return !earshotReplay.clock.playing")
        check_in_step(browser)
        check_keyboard(browser, last)
        check_accessible_tree(browser, last)
        check_tab_order(browser)
        check_reduced_motion(browser)
        if options.screenshot:
            browser.execute_script(f"earshotReplay.goTo({int(0.6 * last)})")
            time.sleep(0.5)
            browser.save_screenshot(str(options.screenshot))
        check_console_and_requests(browser, may_hold_data=True)
        if not options.page:
            check_silence(browser, options.earshot, folder)
    print("passed")


if __name__ == "__main__":
    main()
