//! One test for each case of a table, so that cases run side by side and by name.

/// Makes a test of each name, which gives the name to `check`, and one that the table, whose names `table` lists, has a test
/// for every case and no other. A name stands as [`identifier`] writes it.
macro_rules! tests_of_cases {
    ($check:expr, $table:expr; $($name:ident),* $(,)?) => {
        $(
            #[test]
            fn $name() {
                ($check)(stringify!($name));
            }
        )*

        #[test]
        fn every_case_has_a_test() {
            let table: Vec<String> = $table.map(crate::cases::identifier).collect();
            assert_eq!(table, [$(stringify!($name)),*]);
        }
    };
}

/// A name with `_` for what cannot stand in an identifier.
pub fn identifier(name: &str) -> String {
    let words: Vec<String> = name
        .split(|letter: char| !letter.is_ascii_alphanumeric() && letter != '_')
        .filter(|word| !word.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    let joined = words.join("_");
    if joined.starts_with(|letter: char| letter.is_ascii_digit()) { format!("_{joined}") } else { joined }
}
