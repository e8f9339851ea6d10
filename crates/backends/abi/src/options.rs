//! A session's options, `key=value,key=value`.

use hemicube_contract::backend::BackendError;

/// Options taken by a session one by one. [`finish`](Self::finish) refuses the rest.
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
pub struct Options<'a> {
    /// Keys and values not taken yet.
    rest: Vec<(&'a str, &'a str)>,
    /// Keys asked for, in order: the known options.
    known: Vec<String>,
}

impl<'a> Options<'a> {
    /// Reads `key=value,key=value`; the empty text has none. Space around a part is passed over.
    ///
    /// # Errors
    /// When a part is not `key=value`, or a key is given twice.
    pub fn parse(text: &'a str) -> Result<Self, BackendError> {
        let mut rest: Vec<(&str, &str)> = Vec::new();
        for part in text.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            let (key, value) = part
                .split_once('=')
                .ok_or_else(|| invalid(format!("option `{part}` is not of the form key=value")))?;
            if rest.iter().any(|&(other, _)| other == key) {
                return Err(invalid(format!("option `{key}` is given twice")));
            }
            rest.push((key, value));
        }
        Ok(Self {
            rest,
            known: Vec::new(),
        })
    }

    /// Takes the value of `key`.
    pub fn take(&mut self, key: &str) -> Option<&'a str> {
        self.known.push(key.to_owned());
        let place = self.rest.iter().position(|&(name, _)| name == key)?;
        Some(self.rest.remove(place).1)
    }

    /// Takes the value of a switch, `on` or `off`.
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
    /// When an option was not taken; the message lists the known ones.
    pub fn finish(self) -> Result<(), BackendError> {
        let Some((key, _)) = self.rest.first() else {
            return Ok(());
        };
        let mut message = format!("there is no option `{key}`");
        if let Some((last, others)) = self.known.split_last() {
            message += &match others {
                [] => format!("; there is {last}"),
                others => format!("; there are {} and {last}", others.join(", ")),
            };
        }
        Err(invalid(message))
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
        let mut options = Options::parse("a=1,, b=x=y").expect("good options");
        assert_eq!(options.take("b"), Some("x=y"));
        assert!(options.take_switch("a").is_err());
        assert!(options.finish().is_ok());
        assert!(Options::parse("").expect("no options").finish().is_ok());
        let mut options = Options::parse("speed=11").expect("key=value");
        for key in ["cull", "edges", "batch"] {
            assert_eq!(options.take(key), None);
        }
        let error = options.finish().expect_err("speed is left").to_string();
        assert!(error.contains("`speed`; there are cull, edges and batch"), "{error}");
    }
}
