//! Matching panel labels against patterns.
//!
//! Labels come as `pocket_l`, `Belt Loop 2`, `ChestPocket`; a pattern must match whole words of
//! one, or `label` would match every `labelled_front` and `zip` every `zipped`. Both are cut
//! into lower-case words (at anything that is no letter or digit, at a capital after a small
//! letter, and between letters and digits); a pattern matches if it equals any run of consecutive
//! words written together, or the plural of one. `*` stands for any letters, `?` for one.

/// The lower-case words of a label.
fn words(label: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut last = ' ';
    for c in label.chars() {
        let breaks = (last.is_lowercase() && c.is_uppercase())
            || (last.is_alphabetic() && c.is_numeric())
            || (last.is_numeric() && c.is_alphabetic())
            || !c.is_alphanumeric();
        if breaks {
            words.push(String::new());
        }
        if c.is_alphanumeric() {
            words.last_mut().expect("there is always one").extend(c.to_lowercase());
        }
        last = c;
    }
    words.retain(|w| !w.is_empty());
    words
}

/// Whether `pattern` names a part of `label`.
pub fn matches(pattern: &str, label: &str) -> bool {
    let pattern: Vec<char> =
        pattern.to_lowercase().chars().filter(|c| c.is_alphanumeric() || "*?".contains(*c)).collect();
    if pattern.is_empty() {
        return false;
    }
    let words = words(label);
    (0..words.len()).any(|first| {
        let mut run = String::new();
        words[first..].iter().any(|word| {
            run.push_str(word);
            let text: Vec<char> = run.chars().collect();
            let singular = ["es", "s"].iter().filter_map(|end| run.strip_suffix(end));
            glob(&pattern, &text)
                || singular.into_iter().any(|s| glob(&pattern, &s.chars().collect::<Vec<_>>()))
        })
    })
}

/// Whether `text` is what `pattern` describes, whole.
fn glob(pattern: &[char], text: &[char]) -> bool {
    match pattern.split_first() {
        None => text.is_empty(),
        Some(('*', rest)) => (0..=text.len()).any(|i| glob(rest, &text[i..])),
        Some((p, rest)) => {
            text.split_first().is_some_and(|(t, more)| (*p == '?' || p == t) && glob(rest, more))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn whole_words_match_whatever_the_case() {
        for label in
            ["pocket", "Pocket_L", "chestPocket", "POCKET 2", "pocket3", "back-pockets", "patch.pocket"]
        {
            assert!(matches("pocket", label), "{label}");
        }
        for label in ["belt_loop", "BeltLoop_7", "beltloops", "belt loop"] {
            assert!(matches("belt loop", label), "{label}");
        }
        assert!(matches("patch", "elbow_patches"));
    }

    #[test]
    fn parts_of_words_do_not() {
        for (pattern, label) in [
            ("label", "labelled_front"),
            ("zip", "zipped"),
            ("strap", "strapless_front"),
            ("tag", "stage"),
            ("belt loop", "belt"),
            ("", "front"),
            ("pocket", ""),
        ] {
            assert!(!matches(pattern, label), "{pattern} {label}");
        }
    }

    #[test]
    fn stars_and_question_marks() {
        assert!(matches("*strap", "shoulderstrap_l"));
        assert!(!matches("*strap", "strapless"));
        assert!(matches("trim_?", "trim_a"));
        assert!(!matches("trim_?", "trim_left"));
        assert!(matches("*", "front"));
    }
}
