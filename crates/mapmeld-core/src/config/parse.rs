//! Options from and to JSON; errors name the whole path of the key.

use crate::config::Config;
use crate::error::{Error, Result};

impl Config {
    /// From JSON; keys that do not exist and values of a wrong type are errors that name them.
    pub fn from_json(text: &str) -> Result<Self> {
        let value: serde_json::Value = serde_json::from_str(text)
            .map_err(|e| Error::Config { key: "(whole)".into(), problem: e.to_string() })?;
        let serde_json::Value::Object(stages) = value else {
            return Err(Error::Config {
                key: "(whole)".into(),
                problem: "must be a mapping of stages to options".into(),
            });
        };
        // Each option is set on its own, so that an error knows the whole path of the key.
        let mut config = serde_json::to_value(Config::default()).expect("defaults serialise");
        for (name, value) in stages {
            set(&mut config, &name, &name, value)?;
        }
        let config: Config = serde_json::from_value(config)
            .map_err(|e| Error::Config { key: "(whole)".into(), problem: e.to_string() })?;
        config.validate()?;
        Ok(config)
    }

    /// All options as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("options serialise")
    }
}

/// Sets one option or one stage of options in a configuration of default values.
fn set(
    config: &mut serde_json::Value,
    path: &str,
    name: &str,
    value: serde_json::Value,
) -> Result<()> {
    let map = config.as_object_mut().expect("stages are mappings");
    if !map.contains_key(name) {
        let known: Vec<&str> = map.keys().map(String::as_str).collect();
        return Err(Error::Config {
            key: path.into(),
            problem: format!("no such option; known here: {}", known.join(", ")),
        });
    }
    if map[name].is_object() {
        let serde_json::Value::Object(options) = value else {
            return Err(Error::Config {
                key: path.into(),
                problem: format!("is a stage: give it options, not {value}"),
            });
        };
        for (k, v) in options {
            set(&mut map[name], &format!("{path}.{k}"), &k, v)?;
        }
        return Ok(());
    }
    let before = std::mem::replace(&mut map[name], value.clone());
    // The whole is parsed again for this one option: a wrong type is then known by its path.
    let mut probe = serde_json::to_value(Config::default()).expect("defaults serialise");
    let mut at = &mut probe;
    for part in path.split('.') {
        at = at.get_mut(part).expect("path exists in the defaults");
    }
    *at = value.clone();
    serde_json::from_value::<Config>(probe).map(|_| ()).map_err(|e| Error::Config {
        key: path.into(),
        problem: format!("{value} does not fit ({e}); the default is {before}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::RegistrationConfig;

    #[test]
    fn round_trip_and_partial() {
        assert_eq!(Config::from_json(&Config::default().to_json()).unwrap(), Config::default());
        let c = Config::from_json(r#"{"filter": {"particles": 7}, "threads": 2}"#).unwrap();
        assert_eq!((c.filter.particles, c.threads), (7, Some(2)));
        assert_eq!(c.registration, RegistrationConfig::default());
    }

    #[test]
    fn errors_name_the_key() {
        for (json, key) in [
            (r#"{"filtr": {}}"#, "filtr"),
            (r#"{"filter": {"particels": 3}}"#, "filter.particels"),
            (r#"{"filter": {"particles": -3}}"#, "filter.particles"),
            (r#"{"filter": {"particles": "many"}}"#, "filter.particles"),
            (r#"{"filter": {"particles": 0}}"#, "filter.particles"),
            (r#"{"filter": 5}"#, "filter"),
            (r#"{"perception": {"model": "best"}}"#, "perception.model"),
            (r#"{"fuse": {"resolution": -1}}"#, "fuse.resolution"),
            (r#"{"seed": 1e300}"#, "seed"),
        ] {
            match Config::from_json(json) {
                Err(Error::Config { key: k, .. }) => assert_eq!(k, key, "{json}"),
                other => panic!("{json}: {other:?}"),
            }
        }
    }
}
