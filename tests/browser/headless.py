# SPDX-License-Identifier: Apache-2.0
"""Debian's headless Chromium for the tests of pages; they end with 77 (skipped) without chromium, chromium-driver or python3-selenium."""
import argparse
import contextlib
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

SKIPPED = 77


def skip(what):
    print(f"skipped: {what}")
    sys.exit(SKIPPED)


def run(*command):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def open_browser():
    try:
        from selenium import webdriver
        from selenium.webdriver.chrome.options import Options
        from selenium.webdriver.chrome.service import Service
    except ImportError:
        skip("no python3-selenium")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not chromium or not driver:
        skip("no chromium or no chromium-driver")
    options = Options()
    options.binary_location = chromium
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1440,1040", "--use-angle=swiftshader", "--disable-gpu-compositing",
                     "--enable-unsafe-swiftshader", "--autoplay-policy=no-user-gesture-required", "--hide-scrollbars"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(service=Service(driver), options=options)


def press(browser, *keys):
    from selenium.webdriver.common.action_chains import ActionChains
    chain = ActionChains(browser)
    for key in keys[:-1]:
        chain = chain.key_down(key)
    chain = chain.send_keys(keys[-1])
    for key in keys[:-1]:
        chain = chain.key_up(key)
    chain.perform()


def wait_for(browser, script, seconds=120):
    end = time.time() + seconds
    while time.time() < end:
        value = browser.execute_script(script)
        if value:
            return value
        time.sleep(0.05)
    raise AssertionError(f"not within {seconds} s: {script}")


def accessible(browser):
    """What assistive technology gets: (role, name, properties) of every node of the page that is not ignored."""
    nodes = browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    return [(node["role"]["value"], node.get("name", {}).get("value", ""),
             {item["name"]: item["value"].get("value") for item in node.get("properties", [])} | {"value": node.get("value", {}).get("value")})
            for node in nodes if not node.get("ignored") and node.get("role", {}).get("value")]


def page_options(description):
    """What every test of a page is called with: EARSHOT [--page FILE] [--screenshot FILE]."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("earshot", type=pathlib.Path)
    parser.add_argument("--page", type=pathlib.Path, help="a page that is there already")
    parser.add_argument("--screenshot", type=pathlib.Path, help="PNG of the page")
    return parser.parse_args()


@contextlib.contextmanager
def opened_page(options, make_page):
    """The browser with the page of the options, or else the one that make_page(earshot, folder) makes, opened from disk; that file, and the folder, which is
    gone at the end."""
    browser = open_browser()
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            page = options.page or make_page(options.earshot, folder)
            browser.get(page.resolve().as_uri())
            yield browser, page, folder
    finally:
        browser.quit()


def check_console_and_requests(browser, may_hold_data=False):
    """No error, and nothing asked of a network; data: URLs of the page's own count as requests unless it may hold them."""
    errors = [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    assert not errors, errors
    requests = browser.execute_script("return performance.getEntriesByType('resource').map(entry => entry.name)")
    assert not [name for name in requests if not (may_hold_data and name.startswith("data:"))], requests
