//! A session's options, `key=value,key=value`.

use hemicube_contract::backend::BackendError;

/// Options on their way to being understood: each is taken once, and what is left at the end is an error.
///
/// ```
/// use hemicube_abi::Options;
/// let mut options = Options::parse("timing=on,cull=off")?;
/// assert_eq!(options.take("cull"), Some("off"));
/// assert_eq!(options.take("batch"), None);
/// assert!(options.finish().is_err_and(|error| error.to_string().contains("timing")));
/// # Ok::<(), hemicube_abi::contract::backend::BackendError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Options<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Options<'a> {
    /// Reads `key=value,key=value`; the empty text has none.
    ///
    /// # Errors
    /// When a part is not `key=value`, or a key is given twice.
    pub fn parse(text: &'a str) -> Result<Self, BackendError> {
        let mut options: Vec<(&str, &str)> = Vec::new();
        for part in text.split(',').filter(|part| !part.is_empty()) {
            let (key, value) = part
                .split_once('=')
                .ok_or_else(|| invalid(format!("option `{part}` is not of the form key=value")))?;
            if options.iter().any(|&(other, _)| other == key) {
                return Err(invalid(format!("option `{key}` is given twice")));
            }
            options.push((key, value));
        }
        Ok(Self(options))
    }

    /// The value of `key`, which then counts as understood.
    pub fn take(&mut self, key: &str) -> Option<&'a str> {
        let place = self.0.iter().position(|&(name, _)| name == key)?;
        Some(self.0.remove(place).1)
    }

    /// The value of a switch, `on` or `off`.
    ///
    /// # Errors
    /// When it is something else.
    pub fn take_switch(&mut self, key: &str) -> Result<Option<bool>, BackendError> {
        match self.take(key) {
            None => Ok(None),
            Some("on") => Ok(Some(true)),
            Some("off") => Ok(Some(false)),
            Some(other) => Err(invalid(format!("option `{key}` is `{other}`; it is `on` or `off`"))),
        }
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// When there is an option that nobody took.
    pub fn finish(self) -> Result<(), BackendError> {
        match self.0.first() {
            None => Ok(()),
            Some((key, _)) => Err(invalid(format!("there is no option `{key}`"))),
        }
    }
}

fn invalid(message: String) -> BackendError {
    BackendError::InvalidArgument(message)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_is_named() {
        let wrong = |text: &str| Options::parse(text).expect_err(text).to_string();
        assert!(wrong("fast").contains("fast"));
        assert!(wrong("a=1,b=2,a=3").contains("`a`"));
        let mut options = Options::parse("a=1,,b=x=y").expect("good options");
        assert_eq!(options.take("b"), Some("x=y"));
        assert!(options.take_switch("a").is_err());
        assert!(options.finish().is_ok());
        assert!(Options::parse("").expect("no options").finish().is_ok());
    }
}
