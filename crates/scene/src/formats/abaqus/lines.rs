//! Reads lines: keywords with their parameters, and the data after them.

mod rules;

use super::generate::cylindrical;
use super::model::{Entry, Instance, Kind, Label, Members, Model, NONE, Part, Section, Set, Sides, Surface};
use super::shown;
use crate::bounds::Bounds;
use crate::{Error, Fate, Kind as Lost, ReadOptions};
use glam::{DAffine3, DMat3, DVec3};
use rules::Rules;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Files that include each other, one in the other.
const DEPTH: usize = 16;

/// The model of a file and of what it includes, and the bytes of all of them.
pub(super) fn read(text: &[u8], base_dir: Option<&Path>, options: ReadOptions) -> Result<(Model, usize), Error> {
    let mut reader = Reader {
        model: Model::new(),
        base_dir,
        included: HashSet::new(),
        bytes: text.len(),
        line: 0,
        card: Card::Skipped,
        scope: 0,
        instance: None,
        pending: Vec::new(),
        entry: None,
        rules: Rules::new(text, Bounds::new(text.len(), options)),
    };
    reader.file(text, 0, 0)?;
    reader.close()?;
    Ok((reader.model, reader.bytes))
}

/// The keyword that data lines belong to.
#[derive(Clone, Copy, PartialEq)]
enum Card {
    Skipped,
    Nodes,
    Elements(Kind),
    /// A set, whether its lines are ranges, and the instance that numbers belong to.
    Set(u32, bool, u32),
    Surface(u32),
    /// An instance, and the lines read.
    Placement(u32, u8),
    /// Names of surfaces.
    Combined,
    /// The rule that is read.
    Rule,
}

struct Reader<'a> {
    model: Model,
    base_dir: Option<&'a Path>,
    included: HashSet<PathBuf>,
    bytes: usize,
    /// The line that is read, counted over all files.
    line: u32,
    card: Card,
    /// The part that is read.
    scope: u32,
    instance: Option<u32>,
    /// Numbers of an element that goes on on the next line.
    pending: Vec<u32>,
    /// The entry of the set of the elements that are read.
    entry: Option<u32>,
    rules: Rules,
}

/// A keyword line: the keyword without blanks and in upper case, and the parameters.
struct Keyword {
    name: String,
    parameters: Vec<(String, String)>,
}

impl Keyword {
    fn new(line: &str) -> Self {
        let mut fields = line.split(',');
        let compact = |text: &str| -> String {
            let kept = text.chars().filter(|c| !c.is_whitespace());
            kept.flat_map(char::to_uppercase).collect()
        };
        let name = compact(fields.next().unwrap_or_default().trim_start_matches('*'));
        let parameter = |field: &str| {
            let (key, value) = field.split_once('=').unwrap_or((field, ""));
            (compact(key), value.trim().trim_matches('"').to_owned())
        };
        Self {
            name,
            parameters: fields.filter(|field| !field.trim().is_empty()).map(parameter).collect(),
        }
    }

    fn get(&self, key: &str) -> Option<&str> {
        let found = self.parameters.iter().find(|(name, _)| name == key);
        found.map(|(_, value)| value.as_str())
    }
}

impl Reader<'_> {
    fn fail(&self, reason: impl Into<String>) -> Error {
        self.model.fail(self.line, reason)
    }

    fn unsupported(&self, reason: impl Into<String>) -> Error {
        self.model.at(self.line, Error::unsupported(reason))
    }

    /// Reads the lines of a file.
    fn file(&mut self, text: &[u8], file: u32, depth: usize) -> Result<(), Error> {
        self.model.places.push((self.line + 1, file, 1));
        let mut lines = text.split(|&byte| byte == b'\n').peekable();
        let mut in_file = 0;
        while let Some(line) = lines.next() {
            if line.is_empty() && lines.peek().is_none() {
                break;
            }
            in_file += 1;
            self.line += 1;
            let line = line.trim_ascii();
            if line.is_empty() || line.starts_with(b"**") {
                continue;
            }
            if !line.starts_with(b"*") {
                self.data(line)?;
                continue;
            }
            let mut whole = String::from_utf8_lossy(line).into_owned();
            let first = self.line;
            // A keyword goes on where its line ends in a comma and the next has parameters.
            while whole.ends_with(',')
                && let Some(next) = lines.peek()
                && next.contains(&b'=')
                && !next.trim_ascii().starts_with(b"*")
            {
                whole += &String::from_utf8_lossy(next.trim_ascii());
                lines.next();
                in_file += 1;
                self.line += 1;
            }
            let keyword = Keyword::new(&whole);
            let input = match keyword.name.as_str() {
                "INCLUDE" => {
                    let name = keyword.get("INPUT");
                    Some(name.ok_or_else(|| self.model.fail(first, "`*INCLUDE` without `INPUT=` and a file"))?)
                }
                "NODE" | "ELEMENT" | "ELSET" => keyword.get("INPUT"),
                _ => None,
            };
            if keyword.name != "INCLUDE" {
                self.keyword(&keyword)?;
            }
            if let Some(name) = input {
                self.include(name, depth)?;
                self.model.places.push((self.line + 1, file, in_file + 1));
            }
        }
        Ok(())
    }

    /// Reads a file in the folder of the scene, as if its lines stood here.
    fn include(&mut self, name: &str, depth: usize) -> Result<(), Error> {
        let Some(folder) = self.base_dir else {
            return Err(self.unsupported(format!(
                "`{}` is included, and there is no folder to look in",
                shown(name)
            )));
        };
        if depth >= DEPTH {
            return Err(self.unsupported(format!("more than {DEPTH} files include each other")));
        }
        let name = name.replace('\\', "/");
        let path = folder.join(&name);
        let mut bytes = Vec::new();
        let opened = crate::regular::open_beside(folder, &name);
        let read = opened.and_then(|mut file| std::io::Read::read_to_end(&mut file, &mut bytes));
        let whole = read.and_then(|_| path.canonicalize()).map_err(|error| {
            self.unsupported(format!(
                "`{}` is included and cannot be read: {error}; put it beside the file",
                shown(&name)
            ))
        })?;
        if !self.included.insert(whole) {
            return Err(self.unsupported(format!("`{}` is included a second time", shown(&name))));
        }
        self.bytes = self.bytes.saturating_add(bytes.len());
        #[allow(clippy::cast_possible_truncation, reason = "each file has a line that includes it")]
        let file = self.model.files.len() as u32;
        self.model.files.push(Some(path.clone()));
        let text = crate::text::unmarked(&bytes).map_err(|error| error.in_file(&path))?;
        self.file(text, file, depth + 1)
    }

    /// Records what is not taken as the file says, at this line.
    fn lose(&mut self, fate: Fate, what: &str, next: &str) {
        let place = self.fail("");
        let place = || {
            place
                .line
                .map_or_else(|| "the file".to_owned(), |line| format!("line {line}"))
        };
        self.model.ledger.lose(Lost { fate, what, next }, 1, None, place);
    }

    /// Says so where a keyword that is not read nearly is one that is.
    fn doubt(&mut self, keyword: &Keyword) {
        const READ: &[&str] = &[
            "NODE",
            "ELEMENT",
            "ELSET",
            "NSET",
            "SURFACE",
            "PART",
            "INSTANCE",
            "INCLUDE",
            "NGEN",
            "NFILL",
            "NCOPY",
            "ELGEN",
            "ELCOPY",
            "SYSTEM",
            "SHELLSECTION",
            "SOLIDSECTION",
            "ENDPART",
            "ENDINSTANCE",
        ];
        let is_near = |read: &&&str| keyword.name != **read && distance(&keyword.name, read) <= 1 + read.len() / 8;
        let has_elements = keyword
            .get("TYPE")
            .is_some_and(|kind| Kind::of(&kind.to_uppercase()).is_some());
        let near = READ.iter().find(is_near).copied().or(has_elements.then_some("ELEMENT"));
        if let Some(near) = near {
            let what = format!("keyword `*{}`, not read", shown(&keyword.name));
            self.lose(
                Fate::LeftOut,
                &what,
                &format!("`*{near}` is read; mend it if that is meant"),
            );
        }
    }

    /// Ends the data of a keyword.
    fn close(&mut self) -> Result<(), Error> {
        self.finish_rule()?;
        let Some(&number) = self.pending.first() else {
            return Ok(());
        };
        let found = self.pending.len() - 1;
        Err(self.fail(format!("element {number} ends after {found} nodes; its type has more")))
    }

    fn part(&mut self) -> &mut Part {
        let last = self.model.parts.len() - 1;
        let at = (self.scope as usize).min(last);
        &mut self.model.parts[at]
    }

    fn keyword(&mut self, keyword: &Keyword) -> Result<(), Error> {
        self.close()?;
        self.card = Card::Skipped;
        self.entry = None;
        let named = |key: &str| match keyword.get(key) {
            Some(name) if !name.is_empty() => Ok(name),
            _ => Err(self.fail(format!("`*{}` without `{key}=` and a name", shown(&keyword.name)))),
        };
        match keyword.name.as_str() {
            "NODE" => {
                self.own_part()?;
                self.nodes_of(keyword)?;
                self.card = Card::Nodes;
            }
            "ELEMENT" => {
                let kind = named("TYPE")?.to_uppercase();
                self.own_part()?;
                self.elements(&kind, keyword.get("ELSET"))?;
            }
            "ELSET" => {
                let name = named("ELSET")?.to_owned();
                let instance = match keyword.get("INSTANCE") {
                    None => NONE,
                    Some(instance) => {
                        let found = self.model.instance_names.get(&instance.to_uppercase()).copied();
                        found.ok_or_else(|| self.fail(format!("instance `{}` is not there", shown(instance))))?
                    }
                };
                let set = self.set(&name)?;
                self.model.sets[set as usize].internal |= keyword.get("INTERNAL").is_some();
                self.card = Card::Set(set, keyword.get("GENERATE").is_some(), instance);
            }
            "SURFACE" => {
                let name = named("NAME")?.to_owned();
                let made = keyword.get("COMBINE").is_some() || keyword.get("CROP").is_some();
                match keyword.get("TYPE").map(str::to_uppercase).as_deref() {
                    _ if made => {
                        self.model.ledger.note("surface made of others, which have its sides");
                        self.rules.surfaces.insert((self.scope, name.to_uppercase()));
                        if keyword.get("CROP").is_none() {
                            self.card = Card::Combined;
                        }
                    }
                    None | Some("ELEMENT") => self.card = Card::Surface(self.surface(&name)?),
                    Some(_) => {
                        let next = "surfaces of type ELEMENT are read";
                        self.lose(Fate::LeftOut, "surface that is not of elements, not read", next);
                        self.rules.surfaces.insert((self.scope, name.to_uppercase()));
                    }
                }
            }
            "SHELLSECTION" | "SOLIDSECTION" | "MEMBRANESECTION" | "SURFACESECTION" => {
                if let (Some(set), Some(material)) = (keyword.get("ELSET"), keyword.get("MATERIAL")) {
                    self.model.sections.push(Section {
                        set: set.to_owned(),
                        scope: self.scope,
                        material: material.to_owned(),
                    });
                }
            }
            "PART" => {
                let name = named("NAME")?.to_uppercase();
                self.rules.system = None;
                self.scope = self.new_part()?;
                if self.model.part_names.insert(name, self.scope).is_some() {
                    return Err(self.fail("a part of this name is there already"));
                }
            }
            "ENDPART" | "ENDINSTANCE" => {
                self.scope = 0;
                self.instance = None;
                self.rules.system = None;
            }
            "INSTANCE" => {
                let (name, part) = (named("NAME")?.to_owned(), named("PART")?.to_uppercase());
                self.new_instance(name, &part)?;
            }
            "NMAP" => return Err(self.unsupported("`*NMAP` moves nodes by rule, which is not read; write them out")),
            _ => self.begin_rule(keyword)?,
        }
        Ok(())
    }

    fn elements(&mut self, kind: &str, set: Option<&str>) -> Result<(), Error> {
        let set = match set {
            Some(name) if !name.is_empty() => Some(self.set(name)?),
            _ => None,
        };
        let Some(found) = Kind::of(kind) else {
            let what = format!("`*ELEMENT` of type {}, no shells and no solids, not read", shown(kind));
            self.lose(
                Fate::LeftOut,
                &what,
                "shells and solids are read; mend the type if it is one of these",
            );
            self.model.others.insert(self.scope);
            return Ok(());
        };
        if kind.contains("AX") && self.model.ledger.warnings.len() < 4 {
            let warning = "axisymmetric elements are read as faces where they lie, and not turned about their axis";
            if !self.model.ledger.warnings.iter().any(|other| other == warning) {
                self.model.ledger.warnings.push(warning.to_owned());
            }
        }
        let part = self.part();
        let place = |count: usize| u32::try_from(count).unwrap_or(NONE);
        let (first, first_corner) = (place(part.numbers.len()), place(part.corners.len()));
        part.blocks.push(super::model::Block {
            kind: found,
            first,
            first_corner,
        });
        self.card = Card::Elements(found);
        if let Some(set) = set {
            self.model.sets[set as usize].of_elements = true;
            self.enter(set, Members::Places, first, first, NONE);
            self.entry = Some(self.model.sets[set as usize].last);
        }
        Ok(())
    }

    fn new_part(&mut self) -> Result<u32, Error> {
        let number = u32::try_from(self.model.parts.len()).map_err(|_| self.fail("too many parts"))?;
        self.model.parts.push(Part::default());
        Ok(number)
    }

    fn new_instance(&mut self, name: String, part: &str) -> Result<(), Error> {
        let number = u32::try_from(self.model.instances.len()).map_err(|_| self.fail("too many instances"))?;
        let Some(&part) = self.model.part_names.get(part) else {
            return Err(self.fail(format!("part `{}` of the instance is not there", shown(part))));
        };
        if self.model.instance_names.insert(name.to_uppercase(), number).is_some() {
            return Err(self.fail(format!("instance `{}` is there twice", shown(&name))));
        }
        self.model.instances.push(Instance {
            name,
            part,
            place: DAffine3::IDENTITY,
        });
        self.instance = Some(number);
        self.scope = part;
        self.card = Card::Placement(number, 0);
        Ok(())
    }

    /// Gives an instance that has nodes or elements of its own a part of its own.
    fn own_part(&mut self) -> Result<(), Error> {
        let Some(instance) = self.instance.take() else {
            return Ok(());
        };
        if !self.part().numbers.is_empty() {
            return Err(self.unsupported("an instance has elements, and its part has some, too; keep one of them"));
        }
        self.scope = self.new_part()?;
        self.model.instances[instance as usize].part = self.scope;
        Ok(())
    }

    /// The number of a set, a new one if the name is new.
    fn set(&mut self, name: &str) -> Result<u32, Error> {
        let key = (self.scope, name.to_uppercase());
        if let Some(&set) = self.model.set_names.get(&key) {
            return Ok(set);
        }
        let set = u32::try_from(self.model.sets.len()).map_err(|_| self.fail("too many sets"))?;
        self.model.sets.push(Set {
            name: name.to_owned(),
            scope: self.scope,
            last: NONE,
            lists: false,
            of_elements: false,
            internal: false,
        });
        self.model.set_names.insert(key, set);
        Ok(set)
    }

    fn surface(&mut self, name: &str) -> Result<u32, Error> {
        let key = (self.scope, name.to_uppercase());
        if let Some(&surface) = self.model.surface_names.get(&key) {
            return Ok(surface);
        }
        let surface = u32::try_from(self.model.surfaces.len()).map_err(|_| self.fail("too many surfaces"))?;
        self.model.surfaces.push(Surface {
            name: name.to_owned(),
            scope: self.scope,
        });
        self.model.surface_names.insert(key, surface);
        Ok(surface)
    }

    /// Adds members to a set: to its last entry where they go on from there.
    fn enter(&mut self, set: u32, members: Members, begin: u32, end: u32, instance: u32) {
        let set = &mut self.model.sets[set as usize];
        if let Some(last) = self.model.entries.get_mut(set.last as usize)
            && (last.members, last.end, last.instance) == (members, begin, instance)
            && members != Members::Places
        {
            last.end = end;
            return;
        }
        let number = u32::try_from(self.model.entries.len()).unwrap_or(NONE);
        self.model.entries.push(Entry {
            before: set.last,
            members,
            begin,
            end,
            instance,
        });
        set.last = number;
    }

    fn data(&mut self, line: &[u8]) -> Result<(), Error> {
        match self.card {
            Card::Skipped => Ok(()),
            Card::Nodes => self.node(line),
            Card::Elements(kind) => self.element(line, kind),
            Card::Set(set, ranges, instance) => self.members(line, set, ranges, instance),
            Card::Surface(surface) => self.sides(line, surface),
            Card::Placement(instance, read) => self.place(line, instance, read),
            Card::Combined => self.combined(line),
            Card::Rule => self.rule_line(line),
        }
    }

    fn whole(&self, field: &[u8]) -> Result<u32, Error> {
        let text = std::str::from_utf8(field.trim_ascii()).unwrap_or("?");
        text.parse().map_err(|_| {
            self.fail(format!(
                "`{}` where the number of a node or an element is due",
                shown(text)
            ))
        })
    }

    /// A number; nothing is 0, and exponents may have Fortran's `D`.
    fn real(&self, field: &[u8]) -> Result<f64, Error> {
        let text = std::str::from_utf8(field.trim_ascii()).unwrap_or("?");
        if text.is_empty() {
            return Ok(0.0);
        }
        let parsed = text.parse().or_else(|_| text.replace(['d', 'D'], "e").parse());
        parsed.map_err(|_| self.fail(format!("`{}` where a number is due", shown(text))))
    }

    fn node(&mut self, line: &[u8]) -> Result<(), Error> {
        let mut fields = line.split(|&byte| byte == b',');
        let number = self.whole(fields.next().unwrap_or_default())?;
        let mut point = DVec3::ZERO;
        // Coordinates left out are 0, all three as well.
        for (at, field) in fields.take(3).enumerate() {
            point[at] = self.real(field)?;
        }
        if self.rules.cylindrical {
            point = cylindrical(point);
        }
        if let Some(system) = self.rules.system {
            point = system.transform_point3(point);
        }
        self.rules.note(number);
        let line = self.line;
        let part = self.part();
        part.node_lines.push(line);
        part.node_numbers.push(number);
        part.nodes.push(point);
        Ok(())
    }

    fn element(&mut self, line: &[u8], kind: Kind) -> Result<(), Error> {
        let begins = self.pending.is_empty();
        for field in line.split(|&byte| byte == b',') {
            if field.trim_ascii().is_empty() {
                continue;
            }
            let number = self.whole(field)?;
            self.pending.push(number);
        }
        let due = usize::from(kind.nodes) + 1;
        if begins && self.pending.len() > due {
            // CalculiX takes as many as its type has.
            self.pending.truncate(due);
            let next = "its type or its nodes are wrong";
            self.lose(
                Fate::Doubtful,
                "element with more nodes than its type, read by its first",
                next,
            );
        }
        if self.pending.len() > due {
            let found = self.pending.len() - 1;
            return Err(self.fail(format!(
                "element {} has {found} nodes; its type has {}",
                self.pending[0], kind.nodes
            )));
        }
        if self.pending.len() < due {
            return Ok(());
        }
        let (line, mut pending) = (self.line, std::mem::take(&mut self.pending));
        let part = self.part();
        part.numbers.push(pending[0]);
        part.lines.push(line);
        part.corners.extend_from_slice(&pending[1..=kind.used()]);
        let count = u32::try_from(part.numbers.len()).ok().filter(|&count| count < NONE);
        let count = count.ok_or_else(|| self.fail("more elements than can be numbered"))?;
        pending.clear();
        self.pending = pending;
        if let Some(entry) = self.entry.and_then(|entry| self.model.entries.get_mut(entry as usize)) {
            entry.end = count;
        }
        Ok(())
    }

    fn members(&mut self, line: &[u8], set: u32, ranges: bool, instance: u32) -> Result<(), Error> {
        let place = |pool: &[u32]| u32::try_from(pool.len()).unwrap_or(NONE);
        let begin = place(&self.model.pool);
        if ranges {
            let mut numbers = [0, 0, 1];
            let fields = line.split(|&byte| byte == b',').map(<[u8]>::trim_ascii);
            let mut found = 0;
            for (number, field) in numbers.iter_mut().zip(fields.filter(|field| !field.is_empty())) {
                *number = self.whole(field)?;
                found += 1;
            }
            if found < 2 || numbers[2] == 0 {
                return Err(self.fail("a range is its first and last number and a step above 0"));
            }
            self.model.pool.extend(numbers);
            let end = place(&self.model.pool);
            self.model.sets[set as usize].lists = true;
            self.enter(set, Members::Ranges, begin, end, instance);
            return Ok(());
        }
        for field in line.split(|&byte| byte == b',') {
            let field = field.trim_ascii();
            let Some(first) = field.first() else { continue };
            let begin = place(&self.model.pool);
            if first.is_ascii_digit() {
                let number = self.whole(field)?;
                self.model.pool.push(number);
                self.model.sets[set as usize].lists = true;
                self.enter(set, Members::Numbers, begin, begin + 1, instance);
                continue;
            }
            let name = String::from_utf8_lossy(field);
            let name = name.trim_matches('"');
            // Within an assembly a name is the instance's, if the keyword names one.
            let scope = match self.model.instances.get(instance as usize) {
                Some(instance) => instance.part,
                None => self.scope,
            };
            let Some((other, of)) = self.model.set(scope, name) else {
                return Err(self.fail(format!(
                    "set `{}` is not there; a set must come before those that name it",
                    shown(name)
                )));
            };
            let last = self.model.sets[other as usize].last;
            if last != NONE {
                self.model.pool.extend([last, if of == NONE { instance } else { of }]);
                self.enter(set, Members::Sets, begin, begin + 2, instance);
            }
        }
        Ok(())
    }

    fn sides(&mut self, line: &[u8], surface: u32) -> Result<(), Error> {
        let text = String::from_utf8_lossy(line);
        let mut fields = text.split(',').map(str::trim);
        let target = fields.next().unwrap_or_default().trim_matches('"');
        if target.is_empty() {
            return Err(self.fail("a set or an element is due"));
        }
        let label = fields.next().unwrap_or_default().to_uppercase();
        let label = match (label.as_str(), label.as_bytes()) {
            ("", _) => Label::None,
            ("SPOS" | "SP" | "POS", _) => Label::Front,
            ("SNEG" | "SN" | "NEG", _) => Label::Back,
            (_, &[b'S', digit @ b'1'..=b'6']) => Label::Side(digit - b'0'),
            (_, &[b'E', b'1'..=b'4']) => Label::Edge,
            _ => {
                return Err(self.fail(format!(
                    "`{}` is no label of a side; S1 to S6, SPOS and SNEG are",
                    shown(&label)
                )));
            }
        };
        self.model.sides.push(Sides {
            surface,
            target: target.to_owned(),
            label,
            line: self.line,
        });
        Ok(())
    }

    /// Places an instance: a line for its translation, one for its rotation about two points by degrees.
    fn place(&mut self, line: &[u8], instance: u32, read: u8) -> Result<(), Error> {
        let mut numbers = [0.0; 7];
        for (number, field) in numbers.iter_mut().zip(line.split(|&byte| byte == b',')) {
            *number = self.real(field)?;
        }
        let [x, y, z, a, b, c, degrees] = numbers;
        let first = DVec3::new(x, y, z);
        let step = match read {
            0 => DAffine3::from_translation(first),
            1 => {
                let Some(axis) = (DVec3::new(a, b, c) - first).try_normalize() else {
                    return Err(self.fail("the two points of the axis of a rotation are one"));
                };
                let turn = DMat3::from_axis_angle(axis, degrees.to_radians());
                DAffine3::from_mat3_translation(turn, first - turn * first)
            }
            _ => return Err(self.fail("an instance has a line for its translation and one for its rotation")),
        };
        let place = &mut self.model.instances[instance as usize].place;
        *place = step * *place;
        self.card = Card::Placement(instance, read + 1);
        Ok(())
    }
}

/// Letters to put in, take away or change to make one word of another (Levenshtein 1966).
fn distance(a: &str, b: &str) -> usize {
    if a.len().abs_diff(b.len()) > 3 {
        return usize::MAX;
    }
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut before = row[0];
        row[0] = i + 1;
        for (j, y) in b.bytes().enumerate() {
            let changed = before + usize::from(x != y);
            before = row[j + 1];
            row[j + 1] = changed.min(before + 1).min(row[j] + 1);
        }
    }
    row.last().copied().unwrap_or(0)
}
