//! Reads the keywords and data lines of rules that make nodes and elements, and node sets, where a rule may want them.

use super::super::generate::{self, Builder, Copies, Fill, Line, NodeSet, Refusal, Repeat, WORK};
use super::super::model::Members;
use super::super::shown;
use super::{Card, Keyword, NONE, Reader};
use crate::Error;
use crate::bounds::Bounds;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::{HashMap, HashSet};

/// The state that rules need beyond the model.
pub(super) struct Rules {
    /// The rule that is read, and its line.
    current: Option<(Rule, u32)>,
    /// The local system of nodes.
    pub(super) system: Option<DAffine3>,
    /// Nodes are given by radius, degrees and height.
    pub(super) cylindrical: bool,
    /// The set of the nodes that are read.
    set: Option<(u32, String)>,
    /// Filled only where a rule may name them.
    sets: HashMap<(u32, String), NodeSet>,
    keeps_sets: bool,
    /// Surfaces that have no sides of their own.
    pub(super) surfaces: HashSet<(u32, String)>,
    bounds: Bounds,
    work: u64,
}

/// A rule with its parameters.
pub(super) enum Rule {
    /// `*SYSTEM`: the first line and the second.
    System(Option<[f64; 6]>, Option<DVec3>),
    Nodes {
        arc: bool,
        cylindrical: bool,
        set: Option<(u32, String)>,
    },
    Fill {
        bias: f64,
        set: Option<(u32, String)>,
    },
    Copy(NodeCopies),
    Repeat {
        set: Option<u32>,
    },
    /// `*NSET`, by ranges or numbers.
    Set((u32, String), bool),
}

/// The parameters of `*NCOPY`, and its data lines.
pub(super) struct NodeCopies {
    old: (u32, String),
    new: Option<(u32, String)>,
    shift: i64,
    how: How,
    lines: Vec<[f64; 7]>,
}

#[derive(Clone, Copy, PartialEq)]
enum How {
    Shift,
    Point,
    Line,
    Mirror,
}

impl Rules {
    pub(super) fn new(text: &[u8], bounds: Bounds) -> Self {
        let has = |word: &[u8]| text.windows(word.len()).any(|found| found.eq_ignore_ascii_case(word));
        Self {
            current: None,
            system: None,
            cylindrical: false,
            set: None,
            sets: HashMap::new(),
            keeps_sets: [&b"*NFILL"[..], b"*NCOPY", b"*INCLUDE"].into_iter().any(has),
            surfaces: HashSet::new(),
            bounds,
            work: WORK,
        }
    }

    /// Notes a node that is read in the set of its keyword.
    pub(super) fn note(&mut self, number: u32) {
        if let Some(key) = &self.set
            && let Some(set) = self.sets.get_mut(key)
        {
            set.push(number);
        }
    }
}

impl Reader<'_> {
    fn refuse(&self, line: u32, refusal: Refusal) -> Error {
        match refusal {
            Refusal::Malformed(reason) => self.model.fail(line, reason),
            Refusal::Unsupported(reason) => self.model.at(line, Error::unsupported(reason)),
            Refusal::TooLarge(error) => self.model.at(line, error),
        }
    }

    fn key(&self, name: &str) -> (u32, String) {
        (self.scope, name.to_uppercase())
    }

    fn set_of(&self, keyword: &Keyword, parameter: &str) -> Option<(u32, String)> {
        let name = keyword.get(parameter).filter(|name| !name.is_empty())?;
        Some(self.key(name))
    }

    /// The parameters of `*NODE`.
    pub(super) fn nodes_of(&mut self, keyword: &Keyword) -> Result<(), Error> {
        self.rules.cylindrical = self.is_cylindrical(keyword)?;
        self.rules.set = self.set_of(keyword, "NSET").filter(|_| self.rules.keeps_sets);
        if let Some(key) = self.rules.set.clone() {
            self.rules.sets.entry(key).or_default();
        }
        Ok(())
    }

    fn is_cylindrical(&self, keyword: &Keyword) -> Result<bool, Error> {
        match keyword.get("SYSTEM").map(str::to_uppercase).as_deref() {
            None | Some("" | "R" | "RC") => Ok(false),
            Some("C") => Ok(true),
            Some(other) => Err(self.unsupported(format!(
                "nodes in the system `{}`; R and C are read, so write x, y and z",
                shown(other)
            ))),
        }
    }

    /// Begins a rule, if the keyword is one.
    pub(super) fn begin_rule(&mut self, keyword: &Keyword) -> Result<(), Error> {
        let parameter = |key: &str| -> Result<Option<i64>, Error> {
            let Some(text) = keyword.get(key) else { return Ok(None) };
            let number = text.trim().parse::<i32>();
            let number = number.map_err(|_| self.fail(format!("`{key}={}` is no whole number", shown(text))))?;
            Ok(Some(i64::from(number)))
        };
        let needed = |key: &str| -> Result<i64, Error> {
            parameter(key)?.ok_or_else(|| self.fail(format!("`*{}` without `{key}=` and a number", keyword.name)))
        };
        let set_needed = |key: &str| -> Result<(u32, String), Error> {
            let set = self.set_of(keyword, key);
            set.ok_or_else(|| self.fail(format!("`*{}` without `{key}=` and a set", keyword.name)))
        };
        let refused = |key: &str| match keyword.get(key) {
            Some(_) => Err(self.unsupported(format!("`*{}` with `{key}`; write it out", keyword.name))),
            None => Ok(()),
        };
        let rule = match keyword.name.as_str() {
            "SYSTEM" => Rule::System(None, None),
            "NGEN" => Rule::Nodes {
                arc: match keyword.get("LINE").map(str::to_uppercase).as_deref() {
                    None => false,
                    Some("C") => true,
                    Some(other) => {
                        return Err(self.unsupported(format!(
                            "nodes along `LINE={}`; straight lines and LINE=C are read",
                            shown(other)
                        )));
                    }
                },
                cylindrical: self.is_cylindrical(keyword)?,
                set: self.set_of(keyword, "NSET"),
            },
            "NFILL" => {
                refused("SINGULAR")?;
                refused("TWOSTEP")?;
                Rule::Fill {
                    bias: match keyword.get("BIAS") {
                        None => 1.0,
                        Some(text) => self.real(text.as_bytes())?,
                    },
                    set: self.set_of(keyword, "NSET"),
                }
            }
            "NCOPY" => {
                refused("POLE")?;
                refused("MULTIPLE")?;
                let how = match (
                    keyword.get("SHIFT"),
                    keyword.get("REFLECT").map(str::to_uppercase).as_deref(),
                ) {
                    (Some(_), None) => How::Shift,
                    (None, Some("POINT")) => How::Point,
                    (None, Some("LINE")) => How::Line,
                    (None, Some("MIRROR")) => How::Mirror,
                    _ => return Err(self.fail("`*NCOPY` needs SHIFT or REFLECT=POINT, LINE or MIRROR")),
                };
                Rule::Copy(NodeCopies {
                    old: set_needed("OLDSET")?,
                    new: self.set_of(keyword, "NEWSET"),
                    shift: needed("CHANGENUMBER")?,
                    how,
                    lines: Vec::new(),
                })
            }
            "ELGEN" => {
                let name = keyword.get("ELSET").filter(|name| !name.is_empty());
                Rule::Repeat {
                    set: name.map(|name| self.set(name)).transpose()?,
                }
            }
            "ELCOPY" => {
                let copies = Copies {
                    element_shift: needed("ELEMENTSHIFT")?,
                    node_shift: needed("SHIFTNODES")?,
                    reflect: keyword.get("REFLECT").is_some(),
                };
                let old = set_needed("OLDSET")?.1;
                return self.copy_elements(&old, keyword.get("NEWSET"), &copies);
            }
            "NSET" if self.rules.keeps_sets => match self.node_set(keyword) {
                Some(rule) => rule,
                None => return Ok(()),
            },
            _ => {
                self.doubt(keyword);
                return Ok(());
            }
        };
        self.rules.current = Some((rule, self.line));
        self.card = Card::Rule;
        Ok(())
    }

    /// `*NSET`; none for one that stands elsewhere.
    fn node_set(&mut self, keyword: &Keyword) -> Option<Rule> {
        let key = self.set_of(keyword, "NSET")?;
        let set = self.rules.sets.entry(key.clone()).or_default();
        set.unsorted |= keyword.get("UNSORTED").is_some();
        set.partly |= ["INSTANCE", "ELSET", "SURFACE"]
            .iter()
            .any(|&other| keyword.get(other).is_some());
        (!set.partly).then(|| Rule::Set(key, keyword.get("GENERATE").is_some()))
    }

    /// Reads a data line of the rule.
    pub(super) fn rule_line(&mut self, line: &[u8]) -> Result<(), Error> {
        let Some((rule, begun)) = self.rules.current.take() else {
            return Ok(());
        };
        let rule = self.line_of(rule, line)?;
        self.rules.current = Some((rule, begun));
        Ok(())
    }

    fn line_of(&mut self, mut rule: Rule, line: &[u8]) -> Result<Rule, Error> {
        let fields: Vec<&[u8]> = line.split(|&byte| byte == b',').map(<[u8]>::trim_ascii).collect();
        let real = |reader: &Self, at: usize| reader.real(fields.get(at).copied().unwrap_or_default());
        let number = |reader: &Self, at: usize, default: u32| match fields.get(at) {
            Some(field) if !field.is_empty() => reader.whole(field),
            _ => Ok(default),
        };
        match &mut rule {
            Rule::System(first @ None, _) => {
                let mut numbers = [0.0; 6];
                for (at, to) in numbers.iter_mut().enumerate() {
                    *to = real(self, at)?;
                }
                *first = Some(numbers);
            }
            Rule::System(_, second) => {
                *second = Some(DVec3::new(real(self, 0)?, real(self, 1)?, real(self, 2)?));
            }
            Rule::Nodes { arc, cylindrical, set } => {
                let third = number(self, 3, 0)?;
                let mut point = DVec3::new(real(self, 4)?, real(self, 5)?, real(self, 6)?);
                if *cylindrical {
                    point = generate::cylindrical(point);
                }
                if let Some(system) = self.rules.system {
                    point = system.transform_point3(point);
                }
                let mut made = Line {
                    ends: [number(self, 0, 0)?, number(self, 1, 0)?],
                    step: number(self, 2, 1)?,
                    middle: arc.then_some(point),
                    normal: DVec3::new(real(self, 7)?, real(self, 8)?, real(self, 9)?),
                };
                let nodes = self.build(|builder| {
                    if *arc && third > 0 {
                        made.middle = Some(builder.node(third)?);
                    }
                    builder.line(&made)
                })?;
                self.keep(set.as_ref(), &nodes);
            }
            Rule::Fill { bias, set } => {
                let [from, to] = [self.kept(fields.first())?, self.kept(fields.get(1))?];
                let fill = Fill {
                    intervals: number(self, 2, 1)?.max(1),
                    step: number(self, 3, 1)?,
                    bias: *bias,
                };
                let nodes = self.build(|builder| builder.fill([&from, &to], &fill))?;
                self.keep(set.as_ref(), &nodes);
            }
            Rule::Copy(copies) => {
                let mut numbers = [0.0; 7];
                for (at, to) in numbers.iter_mut().enumerate() {
                    *to = real(self, at)?;
                }
                if copies.lines.len() < 2 {
                    copies.lines.push(numbers);
                }
            }
            Rule::Repeat { set } => {
                let mut repeat = Repeat {
                    master: number(self, 0, 0)?,
                    by: [[1; 3]; 3],
                };
                for (at, to) in repeat.by.iter_mut().flatten().enumerate() {
                    *to = number(self, at + 1, 1)?;
                }
                let master = repeat.master;
                if self.model.others.contains(&self.scope) && !self.build(|builder| Ok(builder.has(master)))? {
                    let next = "shells and solids are read";
                    self.lose(crate::Fate::LeftOut, "rule for elements of other types, not read", next);
                    return Ok(rule);
                }
                let (master, [begin, end]) = self.build(|builder| builder.repeat(&repeat))?;
                if let Some(set) = *set {
                    self.model.sets[set as usize].of_elements = true;
                    self.enter(set, Members::Places, master, master + 1, NONE);
                    self.enter(set, Members::Places, begin, end, NONE);
                }
            }
            Rule::Set(key, ranges) => self.set_line(key, *ranges, &fields),
        }
        Ok(rule)
    }

    /// A line of `*NSET`. What can't be followed is told where a rule wants the set.
    fn set_line(&mut self, key: &(u32, String), ranges: bool, fields: &[&[u8]]) {
        let whole = |field: &&[u8]| {
            std::str::from_utf8(field)
                .ok()
                .and_then(|text| text.parse::<u32>().ok())
        };
        let mut set = self.rules.sets.remove(key).unwrap_or_default();
        if ranges {
            let numbers: Vec<Option<u32>> = fields.iter().filter(|field| !field.is_empty()).map(whole).collect();
            match *numbers {
                [Some(first), Some(last)] => set.push_range(first, last, 1),
                [Some(first), Some(last), Some(step)] => set.push_range(first, last, step),
                _ => set.partly = true,
            }
        } else {
            for field in fields.iter().filter(|field| !field.is_empty()) {
                let name = || self.key(String::from_utf8_lossy(field).trim_matches('"'));
                match (whole(field), self.rules.sets.get(&name())) {
                    (Some(number), _) => set.push(number),
                    (None, Some(other)) => set.extend(other),
                    (None, None) => set.partly = true,
                }
            }
        }
        self.rules.sets.insert(key.clone(), set);
    }

    /// Ends the rule: what needs all of its lines.
    pub(super) fn finish_rule(&mut self) -> Result<(), Error> {
        let Some((rule, line)) = self.rules.current.take() else {
            return Ok(());
        };
        match rule {
            Rule::System(None, _) => self.rules.system = None,
            Rule::System(Some(first), second) => {
                let place = generate::system(first, second).map_err(|refusal| self.refuse(line, refusal))?;
                self.rules.system = Some(place);
            }
            Rule::Copy(copies) => {
                if self.rules.system.is_some() {
                    return Err(self.refuse(
                        line,
                        Refusal::Unsupported("`*NCOPY` within a `*SYSTEM`; write the copies out".to_owned()),
                    ));
                }
                let place = place_of(copies.how, &copies.lines).map_err(|refusal| self.refuse(line, refusal))?;
                let Some(old) = self.rules.sets.get(&copies.old).cloned() else {
                    let reason = format!("node set `{}` is not there", shown(&copies.old.1));
                    return Err(self.model.fail(line, reason));
                };
                let nodes = self.build(|builder| {
                    builder.line = line;
                    builder.copy(&old, copies.shift, place)
                });
                self.keep(copies.new.as_ref(), &nodes?);
            }
            _ => {}
        }
        Ok(())
    }

    fn build<T>(&mut self, rule: impl FnOnce(&mut Builder<'_>) -> Result<T, Refusal>) -> Result<T, Error> {
        self.own_part()?;
        let last = self.model.parts.len() - 1;
        let at = (self.scope as usize).min(last);
        let mut builder = Builder {
            part: &mut self.model.parts[at],
            bounds: &self.rules.bounds,
            line: self.line,
            work: &mut self.rules.work,
        };
        let done = rule(&mut builder);
        let line = builder.line;
        done.map_err(|refusal| self.refuse(line, refusal))
    }

    fn keep(&mut self, set: Option<&(u32, String)>, nodes: &NodeSet) {
        if let Some(key) = set.filter(|_| self.rules.keeps_sets) {
            self.rules.sets.entry(key.clone()).or_default().extend(nodes);
        }
    }

    /// The node set that a field names.
    fn kept(&self, field: Option<&&[u8]>) -> Result<NodeSet, Error> {
        let name = String::from_utf8_lossy(field.copied().unwrap_or_default());
        let name = name.trim_matches('"');
        let set = self.rules.sets.get(&self.key(name)).cloned();
        set.ok_or_else(|| self.fail(format!("node set `{}` is not there", shown(name))))
    }

    fn copy_elements(&mut self, old: &str, new: Option<&str>, copies: &Copies) -> Result<(), Error> {
        let Some((set, NONE)) = self.model.set(self.scope, old) else {
            return Err(self.fail(format!("set `{}` is not there", shown(old))));
        };
        let part = u32::try_from(self.model.parts.len() - 1)
            .unwrap_or(NONE)
            .min(self.scope);
        let members = generate::members(&mut self.model, part, set, &mut self.rules.work);
        let members = members.map_err(|refusal| self.refuse(self.line, refusal))?;
        let [begin, end] = self.build(|builder| builder.copy_elements(&members, copies))?;
        if let Some(new) = new.filter(|name| !name.is_empty()) {
            let new = self.set(new)?;
            self.model.sets[new as usize].of_elements = true;
            self.enter(new, Members::Places, begin, end, NONE);
        }
        Ok(())
    }

    /// A line of a combined surface: names of surfaces before it.
    pub(super) fn combined(&mut self, line: &[u8]) -> Result<(), Error> {
        let text = String::from_utf8_lossy(line);
        for name in text.split(',').map(|name| name.trim().trim_matches('"')) {
            let scoped = match self.model.instance_and(name) {
                Some((instance, rest)) => (self.model.instances[instance as usize].part, rest.to_uppercase()),
                None => self.key(name),
            };
            let known =
                |key: &(u32, String)| self.model.surface_names.contains_key(key) || self.rules.surfaces.contains(key);
            if !name.is_empty() && !known(&scoped) && !known(&self.key(name)) {
                return Err(self.fail(format!(
                    "surface `{}` is not there; a surface must come before those that combine it",
                    shown(name)
                )));
            }
        }
        Ok(())
    }
}

/// The place of the copies of `*NCOPY`, by its data lines.
fn place_of(how: How, lines: &[[f64; 7]]) -> Result<DAffine3, Refusal> {
    let malformed = |reason: &str| Err(Refusal::Malformed(reason.to_owned()));
    let Some(&[x, y, z, u, v, w, _]) = lines.first() else {
        return malformed("`*NCOPY` without data lines");
    };
    let (a, b) = (DVec3::new(x, y, z), DVec3::new(u, v, w));
    let about = |linear: DMat3, point: DVec3| DAffine3::from_mat3_translation(linear, point - linear * point);
    let outer = |axis: DVec3| DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
    match how {
        How::Shift => {
            let moved = DAffine3::from_translation(a);
            let Some(&[x, y, z, u, v, w, degrees]) = lines.get(1) else {
                return Ok(moved);
            };
            let (a, b) = (DVec3::new(x, y, z), DVec3::new(u, v, w));
            match (b - a).try_normalize() {
                Some(axis) => Ok(about(DMat3::from_axis_angle(axis, degrees.to_radians()), a) * moved),
                None if degrees == 0.0 => Ok(moved),
                None => malformed("the two points of the axis of a rotation are one"),
            }
        }
        How::Point => Ok(about(-DMat3::IDENTITY, a)),
        How::Line => match (b - a).try_normalize() {
            Some(axis) => Ok(about(outer(axis) * 2.0 - DMat3::IDENTITY, a)),
            None => malformed("the two points of the line are one"),
        },
        How::Mirror => {
            let Some(&[x, y, z, ..]) = lines.get(1) else {
                return malformed("a mirror has two data lines: two points, and a third");
            };
            match (b - a).cross(DVec3::new(x, y, z) - a).try_normalize() {
                Some(normal) => Ok(about(DMat3::IDENTITY - outer(normal) * 2.0, a)),
                None => malformed("the three points of the mirror lie on one line"),
            }
        }
    }
}
