//! The files of the studio's page.

use lamogen_view::{Studio, studio};

#[test]
fn nothing_is_inline_and_nothing_comes_from_elsewhere() {
    let Studio {
        page,
        script,
        style,
    } = studio();
    for inline in [" style=", " onclick=", "<style", "javascript:", "{{"] {
        assert!(!page.contains(inline), "{inline}");
    }
    assert_eq!(page.matches("<script").count(), 1);
    assert!(page.contains("<script src=\"studio.js\" defer></script>"));
    for text in [&page, &script, &style] {
        let addresses = text.matches("://").count();
        let names = text.matches("http://www.w3.org/2000/svg").count();
        assert_eq!(addresses, names, "an address of another server");
    }
}

#[test]
fn every_element_that_the_script_names_is_on_the_page() {
    let Studio { page, script, .. } = studio();
    let names = script.split("byId(\"").skip(1);
    let mut names: Vec<&str> = names.filter_map(|rest| rest.split('"').next()).collect();
    names.sort_unstable();
    names.dedup();
    assert!(names.len() > 20, "{names:?}");
    for name in names {
        assert!(page.contains(&format!("id=\"{name}\"")), "{name}");
    }
}
