//! The book is whole: every page is in its table of contents, and every link of the project's Markdown leads somewhere.

#![expect(clippy::unwrap_used, reason = "helpers of tests say what they expect in the shortest way, as tests do")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Every Markdown file of the project, but for what is made and what is fetched.
fn pages() -> Vec<PathBuf> {
    fn gather(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if path.is_dir() && !name.starts_with('.') && !["target", "corpus"].contains(&name.as_str()) {
                gather(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    gather(root(), &mut found);
    found
}

/// The text without what stands in blocks of code.
fn prose(text: &str) -> String {
    let mut in_code = false;
    let kept = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        in_code ^= fence;
        !fence && !in_code
    });
    kept.collect::<Vec<_>>().join("\n")
}

/// Where the links of a page lead that stay within the project.
fn links(text: &str) -> Vec<String> {
    let targets = prose(text);
    let targets = targets.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
    targets.filter(|target| !target.contains("://") && !target.starts_with("mailto:")).map(str::to_owned).collect()
}

/// The anchor that a heading gets: lower case, hyphens for spaces, no other marks.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase();
    kept.chars().filter(|c| c.is_alphanumeric() || "-_ ".contains(*c)).map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    let text = prose(text);
    let headings = text.lines().filter(|line| line.starts_with('#'));
    headings.map(|line| anchor(line.trim_start_matches('#').trim())).collect()
}

/// What is wrong with a link of this page.
fn wrong(page: &Path, link: &str) -> Option<String> {
    let (file, heading) = link.split_once('#').map_or((link, None), |(file, heading)| (file, Some(heading)));
    let target = if file.is_empty() { page.to_owned() } else { page.parent().unwrap().join(file) };
    let place = page.strip_prefix(root()).unwrap().display();
    if !target.exists() {
        return Some(format!("{place}: there is no {file}"));
    }
    let heading = heading.filter(|_| target.extension().is_some_and(|extension| extension == "md"))?;
    let known = anchors(&fs::read_to_string(&target).unwrap());
    (!known.contains(heading)).then(|| format!("{place}: {file} has no heading {heading}"))
}

#[test]
fn every_link_leads_somewhere() {
    let pages = pages();
    assert!(pages.len() > 20, "the pages are found: {pages:?}");
    let found: Vec<_> = pages.iter().map(|page| (page, links(&fs::read_to_string(page).unwrap()))).collect();
    assert!(found.iter().map(|(_, links)| links.len()).sum::<usize>() > 100, "links are found");
    let wrong: Vec<_> =
        found.iter().flat_map(|(page, links)| links.iter().filter_map(move |link| wrong(page, link))).collect();
    assert_eq!(wrong, Vec::<String>::new());
}

#[test]
fn every_page_is_in_the_book_and_leads_to_nothing_outside_of_it() {
    let docs = root().join("docs");
    let listed: BTreeSet<_> = links(&fs::read_to_string(docs.join("SUMMARY.md")).unwrap()).into_iter().collect();
    let there: BTreeSet<_> = pages()
        .iter()
        .filter(|page| page.parent() == Some(&docs) && !page.ends_with("SUMMARY.md"))
        .map(|page| page.file_name().unwrap().to_str().unwrap().to_owned())
        .collect();
    assert_eq!(listed, there);
    // The book is copied to where the rest of the project is not.
    let beyond: Vec<_> = there
        .iter()
        .flat_map(|name| links(&fs::read_to_string(docs.join(name)).unwrap()).into_iter().map(move |link| (name, link)))
        .filter(|(_, link)| link.starts_with(".."))
        .collect();
    assert_eq!(beyond, []);
}

#[test]
fn a_link_that_leads_nowhere_is_found() {
    let page = root().join("docs/README.md");
    assert_eq!(wrong(&page, "install.md#debian-package"), None);
    assert_eq!(wrong(&page, "nowhere.md").unwrap(), "docs/README.md: there is no nowhere.md");
    assert_eq!(wrong(&page, "install.md#nothing").unwrap(), "docs/README.md: install.md has no heading nothing");
    assert_eq!(links("[a](b.md) and `code`\n```sh\n[c](d.md)\n```\n[e](https://f)"), ["b.md"]);
}
