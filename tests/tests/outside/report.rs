//! The page of `hemicube report`, in a browser without a window that opens it from the disk.
//!
//! Needs Chromium and its driver; `HEMICUBE_SCREENSHOTS` names a folder where pictures of what was seen are left.
//! The binary is the one beside this test: build it with the same profile and target directory before.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the browser has numbers of patches and places on its canvas as f64"
)]

use hemicube::InputPatch;
use hemicube::store::Store;
use hemicube_tests::browser::Browser;
use hemicube_tests::runs::command_in;
use hemicube_tests::scenes::{program, workspace};
use serde_json::Value;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

fn ran(folder: &Path, line: &str) -> (Option<i32>, String) {
    let output = command_in(&program(), folder)
        .args(line.split_whitespace())
        .output()
        .expect("the program runs");
    let err = String::from_utf8(output.stderr).expect("UTF-8");
    assert!(!err.contains("panicked"), "{err}");
    (output.status.code(), err)
}

#[track_caller]
fn line(folder: &Path, line: &str) {
    let (code, err) = ran(folder, line);
    assert_eq!(code, Some(0), "{line}: {err}");
}

fn cornell() -> PathBuf {
    let path = workspace().join("crates/scene/data/cornell-box.obj");
    path.canonicalize().expect("the Cornell box")
}

/// The matrix of the Cornell box with a solution and a sky beside it, and its page.
fn room(folder: &Path) -> PathBuf {
    let scene = cornell().display().to_string();
    line(
        folder,
        &format!("compute {scene} --split 8 --tolerance 2% -o room.hemicube --config=none"),
    );
    line(folder, &format!("solve room.hemicube --scene {scene}"));
    line(folder, &format!("sky {scene} --matrix room.hemicube --up y"));
    line(folder, &format!("report room.hemicube {scene} -o room.html"));
    folder.join("room.html")
}

fn keep(name: &str, picture: &[u8]) {
    if let Some(folder) = std::env::var_os("HEMICUBE_SCREENSHOTS") {
        std::fs::write(Path::new(&folder).join(name), picture).expect("the folder of pictures can be written");
    }
}

/// How many colours are within the rectangle (left, top, width, height) of a PNG.
fn colors(picture: &[u8], [left, top, width, height]: [usize; 4]) -> usize {
    let mut reader = png::Decoder::new(std::io::Cursor::new(picture))
        .read_info()
        .expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut pixels).expect("pixels");
    let channels = info.color_type.samples();
    let mut found = HashSet::new();
    for y in top..(top + height).min(info.height as usize) {
        let row = &pixels[y * info.line_size..][..info.line_size];
        for pixel in row.chunks_exact(channels).skip(left).take(width) {
            found.insert([pixel[0], pixel[1], pixel[2]]);
        }
    }
    found.len()
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().expect("a list");
    std::array::from_fn(|k| list[k].as_f64().expect("a number"))
}

/// The place of the canvas: left, top, width, height.
fn canvas(browser: &Browser) -> [f64; 4] {
    browser.script("document.getElementById('view').scrollIntoView({ block: 'center' })");
    numbers(&browser.script(
        "const b = document.getElementById('view').getBoundingClientRect(); return [b.x, b.y, b.width, b.height]",
    ))
}

/// Opens the page and waits until it is there. Nothing was said on the console, and nothing asked for but the page.
fn open(browser: &Browser, page: &Path) {
    // Requests of the browser's own first page.
    browser.requests();
    browser.open(page);
    browser.wait("document.documentElement.dataset.ready");
    assert_eq!(
        browser.script("return document.documentElement.dataset.ready"),
        "yes",
        "{:?}",
        browser.script("return document.getElementById('view-error').textContent")
    );
    sound(browser);
}

fn sound(browser: &Browser) {
    let said = browser.log("browser").into_iter();
    // Without a GPU the browser reads each frame back to show it, and remarks on that itself.
    let of_page: Vec<Value> = said
        .filter(|entry| {
            let text = entry["message"].as_str().unwrap_or("");
            entry["source"] != "rendering" || !text.contains("GPU stall due to ReadPixels")
        })
        .collect();
    assert_eq!(of_page, Vec::<Value>::new());
    // The tab that a browser starts with may still be asking for its own pictures, which no page from the disk can.
    for url in browser
        .requests()
        .into_iter()
        .filter(|url| !url.starts_with("chrome://"))
    {
        assert!(
            url.starts_with("file:///") && url.ends_with("/room.html") || url.starts_with("data:image/"),
            "the page asks for {url}"
        );
    }
}

/// The largest `count` entries of a row, largest first; equal ones in their order.
fn largest(store: &Store, patch: u32, count: usize) -> Vec<(u32, f64)> {
    let row = store.row(InputPatch(patch)).expect("a sound store").expect("a row");
    let mut entries: Vec<(u32, f64)> = row.indices.into_iter().zip(&row.data).collect();
    entries.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    entries.truncate(count);
    entries
}

/// A form factor rounded to 11 bits.
fn near(found: f64, wanted: f64) -> bool {
    (found - wanted).abs() <= wanted * 2f64.powi(-11) * 1.001
}

#[test]
fn a_slow_browser_turns_the_model_with_fewer_pixels_and_rests_with_all() {
    let Some(browser) = Browser::start(
        "report::a_slow_browser_turns_the_model_with_fewer_pixels_and_rests_with_all",
        1280,
        1000,
    ) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary directory");
    open(&browser, &room(folder.path()));
    let at = canvas(&browser);
    let whole = browser.script(
        "const model = hemicube.model, draw = model.drawNow.bind(model); window.widths = []; \
         model.drawNow = (late) => { draw(late); window.widths.push(model.canvas.width) }; return model.canvas.width",
    );
    let whole = whole.as_u64().expect("a number");
    // It has no GPU: four pixels at rest for each of the canvas, and two halvings.
    assert_eq!(whole, 2 * at[2].round() as u64);
    let [x, y] = [at[0] + at[2] / 2.0, at[1] + at[3] / 2.0];
    // As if every picture came late, and as if none did.
    for (patience, fewest) in [("-1", whole / 4), ("Infinity", whole)] {
        browser.script(&format!(
            "hemicube.model.patience = {patience}; window.widths.length = 0"
        ));
        browser.drag(&[
            [x, y],
            [x + 40.0, y + 10.0],
            [x + 80.0, y + 20.0],
            [x + 120.0, y + 30.0],
        ]);
        browser.wait("!hemicube.model.turning && !hemicube.model.pending");
        let widths = browser.script("return window.widths");
        let widths: Vec<u64> = widths
            .as_array()
            .expect("a list")
            .iter()
            .filter_map(Value::as_u64)
            .collect();
        assert_eq!(widths.iter().min(), Some(&fewest), "patience {patience}: {widths:?}");
        assert_eq!(widths.last(), Some(&whole), "patience {patience}: {widths:?}");
    }
}

#[test]
fn a_click_shows_the_row_that_the_store_has() {
    let Some(browser) = Browser::start("report::a_click_shows_the_row_that_the_store_has", 1280, 1000) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary directory");
    let page = room(folder.path());
    let store = Store::open(&folder.path().join("room.hemicube")).expect("a store");
    open(&browser, &page);
    let at = canvas(&browser);
    let place = at.map(|number| number.round() as usize);
    let before = browser.screenshot();
    keep("room.png", &before);
    assert!(
        colors(&before, place) > 100,
        "the canvas shows {} colours",
        colors(&before, place)
    );

    // A drag turns the model.
    let frames = browser.script("return hemicube.frames()").as_u64().expect("a number");
    let [x, y] = [at[0] + at[2] / 2.0, at[1] + at[3] / 2.0];
    browser.drag(&[[x, y], [x + 40.0, y + 10.0], [x + 120.0, y + 30.0]]);
    browser.wait(&format!("hemicube.frames() > {frames}"));
    let turned = browser.screenshot();
    assert!(colors(&turned, place) > 100);
    assert_ne!(before, turned, "the drag changed nothing");
    assert_eq!(browser.script("return document.getElementById('patch').hidden"), true);

    // Patches are found where they are drawn, and a click on one shows its row.
    let visible = browser.script(
        "const found = []; for (let p = 0; p < hemicube.head.patches; p += 17) { const [x, y] = hemicube.placeOf(p); \
         if (x > 5 && y > 5 && await hemicube.pick(x, y) === p) found.push([p, x, y]); } return found",
    );
    let visible: Vec<[f64; 3]> = visible.as_array().expect("a list").iter().map(numbers).collect();
    assert!(visible.len() > 10, "{} patches are in sight", visible.len());
    for [patch, x, y] in [visible[3], visible[visible.len() / 2], visible[visible.len() - 4]] {
        let patch = patch as u32;
        browser.drag(&[[at[0] + x, at[1] + y]]);
        browser.wait(&format!(
            "document.getElementById('patch-number').value === '{patch}' && !document.getElementById('row').hidden"
        ));
        // The page has the row in full, and lists the largest hundred.
        let wanted = largest(&store, patch, usize::MAX);
        let shown = browser.script(
            "return [...document.querySelectorAll('#row-entries tr')].map(tr => \
             [Number(tr.querySelector('button').dataset.patch), Number(tr.lastChild.textContent)])",
        );
        let shown: Vec<[f64; 2]> = shown.as_array().expect("a list").iter().map(numbers).collect();
        assert_eq!(shown.len(), wanted.len().min(100));
        let exact = browser.script(&format!(
            "return (await hemicube.row({patch})).entries.map(e => [e.patch, e.factor])"
        ));
        let exact: BTreeMap<u32, f64> = exact
            .as_array()
            .expect("a list")
            .iter()
            .map(numbers::<2>)
            .map(|[patch, factor]| (patch as u32, factor))
            .collect();
        assert_eq!(exact.len(), wanted.len());
        for &(column, factor) in &wanted {
            let found = exact.get(&column).copied().unwrap_or(f64::NAN);
            assert!(
                near(found, factor),
                "F[{patch}, {column}] = {factor}, and the page says {found}"
            );
        }
        // The table shows the same to four figures, the largest first.
        for (column, factor) in shown.iter().map(|&[column, factor]| (column as u32, factor)) {
            assert!((factor / exact[&column] - 1.0).abs() < 6e-4, "{column}: {factor}");
        }
        assert!(shown.is_sorted_by(|a, b| a[1] >= b[1]));

        // The sums by object are those of the whole row.
        let row = store.row(InputPatch(patch)).expect("sound").expect("a row");
        let table = store.patches().expect("a patch table");
        let mut sums: BTreeMap<u32, f64> = BTreeMap::new();
        for (&column, factor) in row.indices.iter().zip(&row.data) {
            *sums.entry(table.object[column as usize]).or_default() += factor;
        }
        let mut best: Vec<f64> = sums.values().copied().filter(|&sum| sum > 0.0).collect();
        best.sort_by(|a, b| b.total_cmp(a));
        best.truncate(8);
        let objects = browser.script(&format!(
            "return (await hemicube.row({patch})).objects.map(o => [o.object, o.factor])"
        ));
        let objects: Vec<[f64; 2]> = objects.as_array().expect("a list").iter().map(numbers).collect();
        assert_eq!(objects.len(), best.len());
        for ([object, factor], best) in objects.into_iter().zip(best) {
            assert!(
                near(factor, best) && near(factor, sums[&(object as u32)]),
                "object {object}: {factor}"
            );
        }
    }

    // In the colours of the row, too, and by everything else that there is.
    let fields = browser.script("return hemicube.head.fields.map(f => f.key)");
    let fields: Vec<&str> = fields
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(Value::as_str)
        .collect();
    for wanted in [
        "radiosity-radiosity",
        "sky",
        "seen",
        "error",
        "closure",
        "row",
        "object",
    ] {
        assert!(fields.contains(&wanted), "{wanted} is not among {fields:?}");
    }
    for field in fields {
        browser.script(&format!(
            "const f = document.getElementById('field'); f.value = '{field}'; f.dispatchEvent(new Event('change')); hemicube.drawNow()"
        ));
        let picture = browser.screenshot();
        keep(&format!("room-{field}.png"), &picture);
        assert!(colors(&picture, place) > 50, "{field}");
    }
    // A patch of the list of the worst is selected by its button.
    let worst = browser.script(
        "const b = document.querySelector('section[aria-labelledby=worst] button'); b.click(); return b.dataset.patch",
    );
    let worst = worst.as_str().expect("a number").to_owned();
    browser.wait(&format!("document.getElementById('patch-number').value === '{worst}'"));
    sound(&browser);
}

#[test]
fn a_number_goes_to_its_patch_and_a_wrong_one_is_refused() {
    let Some(browser) = Browser::start(
        "report::a_number_goes_to_its_patch_and_a_wrong_one_is_refused",
        1280,
        1000,
    ) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary directory");
    let page = room(folder.path());
    let store = Store::open(&folder.path().join("room.hemicube")).expect("a store");
    open(&browser, &page);
    let typed = |number: &str| {
        browser.script(&format!(
            "const f = document.getElementById('patch-number'); f.value = '{number}'; f.dispatchEvent(new Event('change'))"
        ));
    };
    // On the ceiling, the floor, a wall, and in the gap between the blocks.
    for patch in [700, 3, 1500, 2100, 2559] {
        typed(&patch.to_string());
        browser.wait(&format!(
            "document.getElementById('patch-name').textContent.replace(',', '') === 'Patch {patch}'"
        ));
        browser.wait(&format!(
            "await hemicube.pick(hemicube.model.canvas.clientWidth / 2, hemicube.model.canvas.clientHeight / 2) === {patch}"
        ));
    }
    let error = "document.getElementById('patch-error')";
    assert_eq!(browser.script(&format!("return {error}.hidden")), true);
    for (number, words) in [
        ("2560", "There is no patch 2,560"),
        ("-2", "There is no patch -2"),
        ("1.5", "1.5"),
    ] {
        typed(number);
        browser.wait(&format!("!{error}.hidden"));
        let said = browser.script(&format!("return {error}.textContent"));
        let said = said.as_str().expect("a message");
        assert!(said.contains(words) && said.contains("0 to 2,559"), "{said}");
        assert_eq!(
            browser.script("return document.getElementById('patch-name').textContent"),
            "Patch 2,559",
            "the selection stays"
        );
    }
    typed("700");
    browser.wait(&format!("{error}.hidden"));

    // All of the row is in colour, on a scale that says that it is logarithmic.
    browser.script("const f = document.getElementById('field'); f.value = 'row'; f.dispatchEvent(new Event('change'))");
    browser.wait("document.getElementById('legend-what').textContent.includes('patch 700')");
    let entries = largest(&store, 700, usize::MAX).len();
    let label = "return document.getElementById('legend-what').textContent";
    let said = browser.script(label);
    let said = said.as_str().expect("a label");
    assert!(
        said.replace(',', "").contains(&format!("all {entries} entries")) && said.ends_with("logarithmic scale"),
        "{said}"
    );
    let grey = browser.script(
        "let n = 0; for (let p = 0; p < hemicube.head.patches; p++) if (hemicube.model.texels.subarray(4 * p, 4 * p + 3)\
         .every(c => c === 150)) n++; return n",
    );
    assert_eq!(
        grey,
        2560 - entries as u64 - 1,
        "all but the row and its patch are grey"
    );
    browser.script("const l = document.getElementById('log'); l.checked = false; l.dispatchEvent(new Event('change'))");
    assert!(!browser.script(label).as_str().expect("a label").contains("logarithmic"));
    sound(&browser);
}

#[test]
fn the_page_fits_its_window_in_light_and_dark() {
    let Some(browser) = Browser::start("report::the_page_fits_its_window_in_light_and_dark", 1280, 1000) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary directory");
    let page = room(folder.path());
    open(&browser, &page);
    for width in [1280, 700] {
        browser.resize(width, 1000);
        browser.wait(&format!("innerWidth === {width}"));
        for theme in ["light", "dark"] {
            browser.script(&format!(
                "if (document.documentElement.dataset.theme !== '{theme}') document.getElementById('theme').click()"
            ));
            let [content, window] =
                numbers::<2>(&browser.script("return [document.documentElement.scrollWidth, innerWidth]"));
            assert!(content <= window, "{width} {theme}: the page is {content} wide");
            // Letters and what is behind them differ as WCAG 2 asks of small text, 4.5 to 1.
            let contrast = browser.script(
                "const l = c => { const [r, g, b] = c.match(/[\\d.]+/g).map(v => { v /= 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4 }); \
                 return 0.2126 * r + 0.7152 * g + 0.0722 * b }; \
                 const of = (s, back) => { const a = l(getComputedStyle(document.querySelector(s)).color), b = l(getComputedStyle(document.querySelector(back)).backgroundColor); \
                 return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05) }; \
                 return [of('h1', 'body'), of('.card span', '.card'), of('dt', 'section:not(.cards)'), of('.state', '.state')]",
            );
            for (k, ratio) in numbers::<4>(&contrast).into_iter().enumerate() {
                assert!(ratio >= 4.5, "{theme}, {k}: contrast {ratio:.2}");
            }
            for (part, place) in [("top", "0"), ("end", "1e6")] {
                browser.script(&format!("scrollTo(0, {place}); hemicube.drawNow()"));
                keep(&format!("page-{width}-{theme}-{part}.png"), &browser.screenshot());
            }
        }
    }
    sound(&browser);
}

#[test]
fn equal_matrices_have_equal_pages_and_damaged_ones_are_told() {
    let folder = tempfile::tempdir().expect("a temporary directory");
    let (folder, scene) = (folder.path(), cornell().display().to_string());
    line(folder, &format!("compute {scene} --split 4 -o F --config=none"));
    line(folder, &format!("report F {scene} -o a.html"));
    line(
        folder,
        &format!("compute {scene} --split 4 -o F --config=none --overwrite --threads 1"),
    );
    line(folder, &format!("report F {scene} -o b.html"));
    let read = |name: &str| std::fs::read(folder.join(name)).expect("a page");
    assert_eq!(read("a.html"), read("b.html"));
    let text = String::from_utf8(read("a.html")).expect("UTF-8");
    assert!(text.contains("three.js authors"), "the licence is in the page");

    for (line, words) in [
        (format!("report F {scene} -o page.txt"), vec!["page.txt", ".html"]),
        (format!("report G {scene} -o page.html"), vec!["`G` does not exist"]),
        (
            format!("report F {scene} -o page.html --solution other"),
            vec!["other", "hemicube solve"],
        ),
    ] {
        let (code, err) = ran(folder, &line);
        assert_eq!(code, Some(2), "{line}: {err}");
        for word in words {
            assert!(err.contains(word), "`{word}` is not in: {err}");
        }
    }
    let part = folder.join("F/parts/part-00000.npz");
    let mut bytes = std::fs::read(&part).expect("a part");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    std::fs::write(&part, bytes).expect("a part");
    let (code, err) = ran(folder, &format!("report F {scene} -o page.html"));
    assert_eq!(code, Some(2), "{err}");
    assert!(
        err.contains("part-00000.npz") && !folder.join("page.html").exists(),
        "{err}"
    );
}

#[test]
fn a_click_on_any_triangle_of_a_patch_shows_the_row_of_the_patch() {
    let name = "report::a_click_on_any_triangle_of_a_patch_shows_the_row_of_the_patch";
    let Some(browser) = Browser::start(name, 1280, 1000) else {
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary directory");
    let scene = cornell().display().to_string();
    line(
        folder.path(),
        &format!("compute {scene} --split 3 --by object -o room.hemicube"),
    );
    line(
        folder.path(),
        &format!("report room.hemicube {scene} -o room.html --up y"),
    );
    open(&browser, &folder.path().join("room.html"));
    let store = Store::open(&folder.path().join("room.hemicube")).expect("a store");
    let head = browser.script("return [hemicube.head.patches, hemicube.head.elements, hemicube.model.count]");
    assert_eq!(head, serde_json::json!([9, 360, 360]));
    let patch_of = browser.script("return Array.from(hemicube.model.patchOf)");
    let patch_of: Vec<u64> = patch_of
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(Value::as_u64)
        .collect();
    let tall = patch_of.iter().filter(|&&patch| patch == 7).count();
    assert_eq!(tall, 90, "five faces of two triangles in nine");
    canvas(&browser);
    let mut middles = 0;
    for patch in 0..9_u32 {
        browser.script(&format!(
            "window.seen = null; hemicube.visit({patch}).then(() => {{ window.seen = true }})"
        ));
        browser.wait("window.seen");
        let row = browser.script(&format!("return hemicube.row({patch})"));
        let entries = row["entries"].as_array().expect("entries");
        let wanted = largest(&store, patch, entries.len());
        for (entry, (column, factor)) in entries.iter().zip(&wanted) {
            let found = entry["factor"].as_f64().expect("a number");
            assert!(near(found, *factor), "{patch}: {entry} {column} {factor}");
        }
        // The middle of the picture shows that patch.
        browser.script(
            "window.seen = null; const view = document.getElementById('view'); \
             hemicube.pick(view.clientWidth / 2, view.clientHeight / 2).then((at) => { window.seen = [at] })",
        );
        browser.wait("window.seen");
        let found = browser.script("return window.seen[0]");
        let found = found.as_i64().expect("a number");
        assert!((-1..9).contains(&found), "{found} is a patch");
        middles += u32::from(found == i64::from(patch));
    }
    // A block stands before the largest triangle of a wall or two.
    assert!(middles >= 7, "{middles}");
    // All triangles of the selected patch have its colour.
    let red = browser.script(
        "const model = hemicube.model, of = (k) => Array.from(model.texels.subarray(4 * k, 4 * k + 3)).join(); \
         const own = []; for (let k = 0; k < model.count; k++) if (model.patchOf[k] === 8) own.push(of(k)); \
         return [own.length, new Set(own).size, own[0]]",
    );
    assert_eq!(red[1], 1, "{red}");
    assert_eq!(red[2], "214,40,40");
    keep("surfaces.png", &browser.screenshot());
}
