//! Names in order of first use, each with a number: the objects and materials of a scene.

use crate::{Error, ErrorKind};
use std::collections::HashMap;

/// Names by number, in order of first use.
#[derive(Default)]
pub(crate) struct Names {
    numbers: HashMap<String, u32>,
    pub(crate) names: Vec<String>,
}

impl Names {
    /// The number of a name, its next place if it was not used before.
    pub(crate) fn number(&mut self, name: &str) -> Result<u32, Error> {
        if let Some(&number) = self.numbers.get(name) {
            return Ok(number);
        }
        let number = u32::try_from(self.names.len()).map_err(|_| {
            Error::new(ErrorKind::TooLarge(
                "has more names than there are numbers for".to_owned(),
            ))
        })?;
        self.names.push(name.to_owned());
        self.numbers.insert(name.to_owned(), number);
        Ok(number)
    }
}
