# SPDX-License-Identifier: Apache-2.0
"""A page of `earshot leaderboard --html` in headless Chromium, opened from disk: what assistive technology gets, the keyboard, light and dark, narrow
windows, and that nothing is asked of a network.

  leaderboard_page_test.py EARSHOT [--page FILE] [--screenshot FILE]

Needs Debian's chromium, chromium-driver and python3-selenium; ends with 77 (skipped) where one is missing.
"""
from headless import accessible, check_console_and_requests, opened_page, page_options, press, run

LEAST_CONTRAST = 4.5  # WCAG 2.1, 1.4.3, for text of this size

# The least contrast of any text with what is behind it: relative luminances as WCAG 2.1 defines them.
CONTRAST = """
const channels = color => color.match(/[\\d.]+/g).map(Number);
const luminance = color => channels(color).slice(0, 3).map(value => value / 255).map(value => value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4)
  .reduce((sum, value, i) => sum + value * [0.2126, 0.7152, 0.0722][i], 0);
const behind = element => {
  for (; element; element = element.parentElement) {
    const color = getComputedStyle(element).backgroundColor;
    if (channels(color)[3] !== 0) return color;
  }
  return 'rgb(255, 255, 255)';
};
let least = [Infinity, ''];
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (walker.nextNode()) {
  const element = walker.currentNode.parentElement;
  if (!walker.currentNode.textContent.trim() || element.tagName === 'STYLE') continue;
  const pair = [luminance(getComputedStyle(element).color), luminance(behind(element))].sort((a, b) => b - a);
  const contrast = (pair[0] + 0.05) / (pair[1] + 0.05);
  if (contrast < least[0]) least = [contrast, walker.currentNode.textContent.trim()];
}
return least.concat([behind(document.body)]);
"""


def make_page(earshot, folder):
    """Two baselines in eight small houses with sounds of three kinds."""
    episodes, page = folder / "set.json", folder / "index.html"
    sounds = folder / "config.yaml"
    sounds.write_text(f"""env: {{task: {{max_steps: 60}}, observation: {{depth: false, spectrogram: false, pointgoal: true}}}}
data:
  train: {{file: {folder / "train.json"}, scenes: ["house:1,rooms=2,area_m2=24"], episodes_per_scene: 1, sounds: ["synth:bird:0"], filter: {{min_geodesic_m: 1, min_ratio: 1}}}}
  eval: {{file: {episodes}, scenes: ["house:11..23,rooms=2,area_m2=24", "house:24,rooms=4,area_m2=60"], episodes_per_scene: 3, sounds: ["synth:bird:0", "synth:bird:1", "synth:noise:0"],
    filter: {{min_geodesic_m: 1, min_ratio: 1}}}}
""")
    run(earshot, "dataset", "episodes", "--config", sounds)
    for agent in ("oracle", "random"):
        run(earshot, "eval", agent, "--config", sounds, "--out", folder / f"{agent}.json")
    run(earshot, "leaderboard", folder / "oracle.json", folder / "random.json", "--html", page, "--link", "curve.svg=curve",
        "--replay", "oracle=oracle_best.html=best", "--replay", "oracle=oracle_worst.html=worst")
    return page


def check_accessible_tree(browser):
    tree = accessible(browser)
    named = lambda *roles: [name for role, name, _ in tree if role in roles]
    assert named("main") and named("banner") and named("navigation") == ["Other pages"]
    assert len(named("heading")) >= 4 and all(named("heading")), named("heading")
    tables = named("table")
    assert len(tables) >= 5 and all(tables) and len(set(tables)) == len(tables), tables
    for wanted in ("Agents by SPL", "By kind of sound, success", "By kind of sound, SPL", "By size of the scene, SPL", "By geodesic distance from start to goal, SPL",
                   "By novelty of the sound, SPL"):
        assert any(name.startswith(wanted) for name in tables), tables
    assert {"rank", "agent", "success", "SPL", "replays", "kind of sound", "distance"} <= set(named("columnheader")), named("columnheader")
    assert {"oracle", "random", "bird", "noise", "heard", "unheard", "unheard kind"} <= set(named("rowheader")), named("rowheader")
    assert {"best", "worst", "curve"} <= set(named("link")), named("link")
    assert all(named("region")) and len(named("region")) == len(tables), named("region")
    folded = len(browser.find_elements("css selector", "details table"))
    print(f"screen reader gets: {len(tables)} tables with captions and {folded} folded, {len(named('columnheader'))} column and {len(named('rowheader'))} row headers, "
          f"{len(named('heading'))} headings, {len(named('link'))} links")


def check_keyboard(browser):
    from selenium.webdriver.common.keys import Keys
    press(browser, Keys.HOME)
    reached = []
    for _ in range(60):
        press(browser, Keys.TAB)
        reached.append(browser.execute_script("const e = document.activeElement; return [e.tagName, e.textContent.slice(0, 30), getComputedStyle(e).outlineStyle]"))
        if reached[-1][0] == "SUMMARY":
            break
    assert all(outline != "none" for _, _, outline in reached), reached
    assert {"A", "DIV", "SUMMARY"} <= {tag for tag, _, _ in reached}, reached
    before = len([1 for role, _, _ in accessible(browser) if role == "table"])
    press(browser, Keys.ENTER)
    tables = len([1 for role, _, _ in accessible(browser) if role == "table"])
    assert tables == before + 2, f"Enter on the folded section shows {tables - before} tables"
    press(browser, Keys.ENTER)


def check_colors(browser):
    behind = {}
    for scheme in ("light", "dark"):
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]})
        contrast, text, behind[scheme] = browser.execute_script(CONTRAST)
        print(f"{scheme}: least contrast {contrast:.1f} ('{text}')")
        assert contrast >= LEAST_CONTRAST, (scheme, contrast, text)
    assert behind["light"] != behind["dark"], behind
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def check_narrow(browser):
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": False})
    page, table = browser.execute_script("const t = document.querySelector('.scroll'); return [document.documentElement.scrollWidth, t.scrollWidth > t.clientWidth]")
    assert page <= 400 and table, f"the page is {page} px wide in a window of 400"
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def main():
    options = page_options(__doc__)
    with opened_page(options, make_page) as (browser, page, _):
        print(f"page: {page.stat().st_size / 1e3:.0f} kB")
        if not options.page:
            check_accessible_tree(browser)
            check_keyboard(browser)
            check_narrow(browser)
        check_colors(browser)
        if options.screenshot:
            browser.execute_script("window.scrollTo(0, 0)")
            browser.save_screenshot(str(options.screenshot))
        check_console_and_requests(browser)
    print("passed")


if __name__ == "__main__":
    main()
