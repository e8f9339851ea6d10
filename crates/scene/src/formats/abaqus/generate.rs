//! Makes nodes and elements of others by rule: `*NGEN`, `*NFILL`, `*NCOPY`, `*ELGEN`, `*ELCOPY`; and places nodes that
//! are given in a system of their own: `*SYSTEM`, cylindrical coordinates.
//!
//! Source: *Abaqus Keywords Reference* (`*NGEN`, `*SYSTEM`, `*SURFACE`; 2017) and *Abaqus Analysis User's Guide*, node
//! definition and element definition. A node that a rule makes again has its new place.
//!
//! No parabolas, arcs of half a turn and more, spherical coordinates, poles and `TWO STEP`, because what they mean in
//! full is in figures that no text tells.

use super::model::{Block, Members, Model, NONE, Part};
use crate::bounds::Bounds;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::HashMap;

/// Largest ratio of a second radius of an arc to its first that is rounding.
const RADII: f64 = 1e-3;

/// The reason that a rule can't be followed.
pub(super) enum Refusal {
    Malformed(String),
    Unsupported(String),
    TooLarge(crate::Error),
}

/// Steps that all rules of a file may take.
pub(super) const WORK: u64 = 1 << 25;

fn spend(work: &mut u64, steps: u64) -> Result<(), Refusal> {
    *work = work.saturating_sub(steps);
    match *work {
        0 => unsupported("the rules of this file take too long; write its nodes and elements out"),
        _ => Ok(()),
    }
}

fn malformed<T>(reason: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal::Malformed(reason.into()))
}

fn unsupported<T>(reason: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal::Unsupported(reason.into()))
}

/// Places of numbers, brought up to date when they are asked for.
#[derive(Default)]
pub(super) struct Places {
    of: HashMap<u32, u32>,
    known: usize,
}

impl Places {
    fn of(&mut self, numbers: &[u32], number: u32) -> Option<usize> {
        // Only the new ones are looked at: to skip those before would take time by their square.
        let new = numbers.get(self.known..).unwrap_or_default();
        for (at, &number) in (self.known..).zip(new) {
            self.of.insert(number, narrow(at));
        }
        self.known = numbers.len();
        self.of.get(&number).map(|&at| at as usize)
    }
}

/// Nodes of a name: runs of a first number, a last one and a step.
#[derive(Clone, Default)]
pub(super) struct NodeSet {
    runs: Vec<[u32; 3]>,
    /// In the order in which they are listed.
    pub(super) unsorted: bool,
    /// It holds what is not followed here.
    pub(super) partly: bool,
}

impl NodeSet {
    pub(super) fn push(&mut self, number: u32) {
        match self.runs.last_mut() {
            Some([_, last, 1]) if last.checked_add(1) == Some(number) => *last = number,
            _ => self.runs.push([number, number, 1]),
        }
    }

    pub(super) fn push_range(&mut self, first: u32, last: u32, step: u32) {
        self.runs.push([first, last, step.max(1)]);
    }

    pub(super) fn extend(&mut self, other: &Self) {
        self.runs.extend_from_slice(&other.runs);
        self.partly |= other.partly;
    }

    /// The numbers in order; no more than there are nodes.
    fn numbers(&self, nodes: usize, work: &mut u64) -> Result<Vec<u32>, Refusal> {
        if self.partly {
            return unsupported("its node set is made of sets or surfaces that are not read; list its nodes");
        }
        let mut numbers = Vec::new();
        for &[first, last, step] in &self.runs {
            let count = u64::from(last.saturating_sub(first) / step) + 1;
            if numbers.len() as u64 + count > nodes as u64 {
                return malformed("its node set has more nodes than there are");
            }
            spend(work, count)?;
            numbers.extend((first..=last.max(first)).step_by(step as usize));
        }
        if !self.unsorted {
            numbers.sort_unstable();
            numbers.dedup();
        }
        Ok(numbers)
    }
}

/// The place of a local system: data lines of `*SYSTEM`, blank for the global one.
pub(super) fn system(first: [f64; 6], second: Option<DVec3>) -> Result<DAffine3, Refusal> {
    let [x, y, z, ..] = first;
    let origin = DVec3::new(x, y, z);
    let mut along = DVec3::new(first[3], first[4], first[5]) - origin;
    if first[3..] == [0.0; 3] {
        return Ok(DAffine3::from_translation(origin));
    }
    let across = match second {
        Some(point) => point - origin,
        // Without a third point the z-axis stays, and x is what the first lies along in the plane.
        None => {
            along.z = 0.0;
            DVec3::Z.cross(along)
        }
    };
    let (Some(right), Some(up)) = (along.try_normalize(), along.cross(across).try_normalize()) else {
        return malformed("the points of the system lie on one line");
    };
    Ok(DAffine3::from_mat3_translation(
        DMat3::from_cols(right, up.cross(right), up),
        origin,
    ))
}

/// The place of cylindrical coordinates: radius, degrees and height.
pub(super) fn cylindrical(at: DVec3) -> DVec3 {
    let (sin, cos) = at.y.to_radians().sin_cos();
    DVec3::new(at.x * cos, at.x * sin, at.z)
}

/// A line of `*NGEN`: nodes from `ends[0]` to `ends[1]` by `step`, straight or about a middle.
pub(super) struct Line {
    pub(super) ends: [u32; 2],
    pub(super) step: u32,
    pub(super) middle: Option<DVec3>,
    pub(super) normal: DVec3,
}

/// A line of `*NFILL`.
pub(super) struct Fill {
    pub(super) intervals: u32,
    pub(super) step: u32,
    /// The ratio of adjacent distances between nodes, the one nearer to the first set over the other.
    pub(super) bias: f64,
}

/// A line of `*ELGEN`: a master, and for rows, lines of rows and layers the count and the steps of nodes and elements.
pub(super) struct Repeat {
    pub(super) master: u32,
    pub(super) by: [[u32; 3]; 3],
}

/// The parameters of `*ELCOPY`.
pub(super) struct Copies {
    pub(super) element_shift: i64,
    pub(super) node_shift: i64,
    /// The copies' corners run the other way round.
    pub(super) reflect: bool,
}

/// A part that nodes and elements are added to, and the line that asks for it.
pub(super) struct Builder<'a> {
    pub(super) part: &'a mut Part,
    pub(super) bounds: &'a Bounds,
    pub(super) line: u32,
    /// Steps left of [`WORK`].
    pub(super) work: &'a mut u64,
}

impl Builder<'_> {
    pub(super) fn node(&mut self, number: u32) -> Result<DVec3, Refusal> {
        match self.part.node_places.of(&self.part.node_numbers, number) {
            Some(at) => Ok(self.part.nodes[at]),
            None => malformed(format!("node {number} is not there; a rule must come after its nodes")),
        }
    }

    fn put(&mut self, number: i64, node: DVec3) -> Result<u32, Refusal> {
        let Some(number) = u32::try_from(number).ok().filter(|&number| number > 0) else {
            return malformed(format!("makes a node of number {number}"));
        };
        spend(self.work, 1)?;
        if let Some(at) = self.part.node_places.of(&self.part.node_numbers, number) {
            self.part.nodes[at] = node;
            return Ok(number);
        }
        let count = self.part.nodes.len() as u64 + 1;
        self.bounds.triangles(count, 0).map_err(Refusal::TooLarge)?;
        self.part.node_lines.push(self.line);
        self.part.node_numbers.push(number);
        self.part.nodes.push(node);
        Ok(number)
    }

    /// Makes the nodes between two, and returns the numbers of all.
    pub(super) fn line(&mut self, line: &Line) -> Result<NodeSet, Refusal> {
        let [first, last] = line.ends;
        let (a, b) = (self.node(first)?, self.node(last)?);
        let span = first.abs_diff(last);
        if line.step == 0 || span == 0 || !span.is_multiple_of(line.step) {
            return malformed(format!(
                "nodes from {first} to {last} are not a step of {} apart",
                line.step
            ));
        }
        let count = span / line.step;
        let at: Box<dyn Fn(f64) -> DVec3> = match line.middle {
            None => Box::new(move |t| a.lerp(b, t)),
            Some(middle) => {
                let (from, to) = (a - middle, b - middle);
                let axis = from.cross(to).normalize_or_zero();
                if axis == DVec3::ZERO || line.normal.dot(axis) < 0.0 {
                    return unsupported("an arc of half a turn or more; make it of two");
                }
                if (to.length() / from.length() - 1.0).abs() > RADII {
                    return malformed("the ends of the arc are not as far from its middle as each other");
                }
                let angle = from.angle_between(to);
                let scale = to.length() / from.length() - 1.0;
                Box::new(move |t| middle + DMat3::from_axis_angle(axis, t * angle) * from * (1.0 + t * scale))
            }
        };
        let step = i64::from(line.step) * if last > first { 1 } else { -1 };
        let mut set = NodeSet::default();
        set.push(first);
        for k in 1..count {
            let number = i64::from(first) + i64::from(k) * step;
            set.push(self.put(number, at(f64::from(k) / f64::from(count)))?);
        }
        set.push(last);
        Ok(set)
    }

    /// Makes the nodes between those of two sets, one by one, and returns the numbers of all.
    pub(super) fn fill(&mut self, sets: [&NodeSet; 2], fill: &Fill) -> Result<NodeSet, Refusal> {
        let count = self.part.nodes.len();
        let [from, to] = [sets[0].numbers(count, self.work)?, sets[1].numbers(count, self.work)?];
        if from.len() != to.len() || from.is_empty() {
            return malformed(format!(
                "its sets have {} and {} nodes; as many are needed in both",
                from.len(),
                to.len()
            ));
        }
        if !(fill.bias.is_finite() && fill.bias > 0.0) {
            return malformed("its bias is no number above 0");
        }
        if fill.step == 0 && fill.intervals > 1 {
            return malformed("its nodes are all of one number; a step from 1 on is needed");
        }
        let mut set = NodeSet::default();
        for (&first, &last) in from.iter().zip(&to) {
            let (a, b) = (self.node(first)?, self.node(last)?);
            set.push(first);
            for k in 1..fill.intervals {
                // Lengths 1, 1/bias, 1/bias² and so on.
                let share = |n: u32| match fill.bias.recip() {
                    1.0 => f64::from(n),
                    ratio => (ratio.powf(f64::from(n)) - 1.0) / (ratio - 1.0),
                };
                let t = share(k) / share(fill.intervals);
                if !t.is_finite() {
                    return malformed("its bias is too far from 1 for so many intervals");
                }
                let number = i64::from(first) + i64::from(k) * i64::from(fill.step);
                set.push(self.put(number, a.lerp(b, t))?);
            }
            set.push(last);
        }
        Ok(set)
    }

    /// Copies nodes of a set to where `place` puts them, and returns the copies' numbers.
    pub(super) fn copy(&mut self, set: &NodeSet, shift: i64, place: DAffine3) -> Result<NodeSet, Refusal> {
        let mut copies = NodeSet::default();
        for number in set.numbers(self.part.nodes.len(), self.work)? {
            let node = place.transform_point3(self.node(number)?);
            copies.push(self.put(i64::from(number).saturating_add(shift), node)?);
        }
        Ok(copies)
    }

    /// Adds copies of elements, as (place, shift of the number, shift of the nodes); returns their places.
    fn elements(
        &mut self,
        copies: impl Iterator<Item = (usize, [i64; 2])>,
        reflect: bool,
    ) -> Result<[u32; 2], Refusal> {
        let place = |count: usize| u32::try_from(count).unwrap_or(NONE);
        let begin = place(self.part.numbers.len());
        for (at, [number, nodes]) in copies {
            let in_block = self.part.blocks.partition_point(|block| block.first as usize <= at) - 1;
            let Block {
                kind,
                first,
                first_corner,
            } = self.part.blocks[in_block];
            if reflect && kind.shape != crate::mesh::Shape::Polygon {
                return unsupported("solids are reflected; write their elements out");
            }
            let count = kind.used();
            let corner = first_corner as usize + (at - first as usize) * count;
            let shifted = |number: u32, shift: i64| u32::try_from(i64::from(number).saturating_add(shift)).ok();
            let corners: Option<Vec<u32>> = self.part.corners[corner..corner + count]
                .iter()
                .map(|&node| shifted(node, nodes))
                .collect();
            let (Some(own), Some(mut corners)) = (shifted(self.part.numbers[at], number), corners) else {
                return malformed("makes an element or a node of a number that can't be");
            };
            if reflect {
                let (corners, others) = corners.split_at_mut(usize::from(kind.corners));
                corners[1..].reverse();
                // The edges after the corners.
                let mids = others.len().min(corners.len());
                others[..mids].reverse();
            }
            let total = self.part.numbers.len() as u64 + 1;
            spend(self.work, 1)?;
            self.bounds.triangles(total, 0).map_err(Refusal::TooLarge)?;
            if self.part.blocks.last().is_none_or(|block| block.kind != kind) || place(self.part.numbers.len()) == begin
            {
                self.part.blocks.push(Block {
                    kind,
                    first: place(self.part.numbers.len()),
                    first_corner: place(self.part.corners.len()),
                });
            }
            self.part.numbers.push(own);
            self.part.lines.push(self.line);
            self.part.corners.extend(corners);
        }
        Ok([begin, place(self.part.numbers.len())])
    }

    /// Returns whether an element is there.
    pub(super) fn has(&mut self, element: u32) -> bool {
        self.part.places.of(&self.part.numbers, element).is_some()
    }

    /// Repeats an element in rows, lines of rows and layers; returns the place of the master and of the copies.
    pub(super) fn repeat(&mut self, repeat: &Repeat) -> Result<(u32, [u32; 2]), Refusal> {
        let Some(master) = self.part.places.of(&self.part.numbers, repeat.master) else {
            return malformed(format!(
                "element {} is not there; a rule must come after its elements",
                repeat.master
            ));
        };
        let [rows, lines, layers] = repeat.by.map(|[count, ..]| u64::from(count.max(1)));
        let total = rows.saturating_mul(lines).saturating_mul(layers);
        self.bounds
            .triangles(total.saturating_add(self.part.numbers.len() as u64), 0)
            .map_err(Refusal::TooLarge)?;
        let copies = (1..total).map(|at| {
            let steps = [at % rows, at / rows % lines, at / rows / lines];
            let shift = |which: usize| {
                let by = steps.iter().zip(&repeat.by);
                by.map(|(&step, by)| {
                    i64::try_from(step)
                        .unwrap_or(i64::MAX)
                        .saturating_mul(i64::from(by[which]))
                })
                .fold(0, i64::saturating_add)
            };
            (master, [shift(2), shift(1)])
        });
        let made = self.elements(copies, false)?;
        Ok((u32::try_from(master).unwrap_or(NONE), made))
    }

    /// Copies elements at the given places; returns the copies' places.
    pub(super) fn copy_elements(&mut self, of: &[u32], copies: &Copies) -> Result<[u32; 2], Refusal> {
        let shifts = [copies.element_shift, copies.node_shift];
        self.elements(of.iter().map(|&at| (at as usize, shifts)), copies.reflect)
    }
}

/// The places of the elements of a set that are there by now, in order.
pub(super) fn members(model: &mut Model, part: u32, set: u32, work: &mut u64) -> Result<Vec<u32>, Refusal> {
    let mut found = Vec::new();
    let mut pending = vec![model.sets[set as usize].last];
    let mut visited = std::collections::HashSet::new();
    while let Some(entry) = pending.pop() {
        let Some(&entry) = (entry != NONE && visited.insert(entry))
            .then(|| model.entries.get(entry as usize))
            .flatten()
        else {
            continue;
        };
        pending.push(entry.before);
        let before = found.len();
        if entry.instance != NONE {
            return unsupported("its set is of an instance");
        }
        let Part { numbers, places, .. } = &mut model.parts[part as usize];
        let pool = model
            .pool
            .get(entry.begin as usize..entry.end as usize)
            .unwrap_or_default();
        match entry.members {
            Members::Places => found.extend(entry.begin..entry.end),
            Members::Numbers => found.extend(pool.iter().filter_map(|&number| places.of(numbers, number)).map(narrow)),
            Members::Ranges => {
                for &[first, last, step] in pool.as_chunks::<3>().0 {
                    spend(work, numbers.len() as u64)?;
                    let within =
                        |number: &u32| (first..=last).contains(number) && (number - first).is_multiple_of(step);
                    let hits = (0..).zip(numbers.iter()).filter(|(_, number)| within(number));
                    found.extend(hits.map(|(at, _): (u32, _)| at));
                }
            }
            Members::Sets => pending.extend(pool.as_chunks::<2>().0.iter().map(|&[last, _]| last)),
        }
        spend(work, (found.len() - before) as u64)?;
    }
    found.sort_unstable();
    found.dedup();
    Ok(found)
}

fn narrow(at: usize) -> u32 {
    u32::try_from(at).unwrap_or(NONE)
}

#[cfg(test)]
mod tests {
    use crate::{ErrorKind, ReadOptions, Scene, abaqus};
    use glam::DVec3;

    fn open(text: &str) -> Result<Scene, crate::Error> {
        abaqus::read(text.as_bytes(), None, ReadOptions::default())
    }

    /// The corners of triangles, each from its least, in order: the same surface however it is listed.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "millionths of less than a thousand units"
    )]
    fn shape(text: &str) -> Vec<(String, Vec<[i64; 3]>)> {
        let scene = open(text).expect("a good file");
        let place = |p: DVec3| (p * 1e6).round().to_array().map(|x| x as i64);
        let mut all: Vec<_> = scene
            .triangles
            .iter()
            .map(|triangle| {
                let mut corners: Vec<[i64; 3]> = triangle.corners.iter().map(|&p| place(p)).collect();
                let least = (0..3).min_by_key(|&at| corners[at]).expect("three corners");
                corners.rotate_left(least);
                (scene.objects[triangle.object as usize].clone(), corners)
            })
            .collect();
        all.sort();
        all
    }

    /// A plate of 3 × 2 quadrilaterals from 0 to (6, 2), at a height, in the order of its rows.
    fn plate(first: u32, height: f64, xs: [f64; 4], set: &str) -> String {
        let mut text = "*NODE\n".to_owned();
        for (row, y) in [0.0, 1.0, 2.0].iter().enumerate() {
            for (at, x) in xs.iter().enumerate() {
                text += &format!("{}, {x}, {y}, {height}\n", first as usize + 10 * row + at);
            }
        }
        text += &format!("*ELEMENT, TYPE=S4, ELSET={set}\n");
        for row in 0..2 {
            for at in 0..3 {
                let a = first + 10 * row + at;
                text += &format!("{a}, {a}, {}, {}, {}\n", a + 1, a + 11, a + 10);
            }
        }
        text
    }

    const EVEN: [f64; 4] = [0.0, 2.0, 4.0, 6.0];

    #[test]
    fn rows_of_elements_are_those_written_out() {
        let rule = "*NODE\n1, 0, 0, 1\n4, 6, 0, 1\n21, 0, 2, 1\n24, 6, 2, 1\n*NGEN, NSET=low\n1, 4\n\
            *NGEN, NSET=high\n21, 24, 1\n*NFILL, NSET=all\nlow, high, 2, 10\n\
            *ELEMENT, TYPE=S4\n1, 1, 2, 12, 11\n*ELGEN, ELSET=plate\n1, 3, 1, 1, 2, 10, 10\n";
        assert_eq!(shape(rule), shape(&plate(1, 1.0, EVEN, "plate")));
        // Adjacent distances 1 : 2 : 4 from the first set on, at a bias of a half.
        let bias = "*NODE\n1, 0, 0, 0\n21, 0, 2, 0\n4, 7, 0, 0\n24, 7, 2, 0\n*NGEN, NSET=left\n1, 21, 10\n\
            *NGEN, NSET=right\n4, 24, 10\n*NFILL, BIAS=0.5\nleft, right, 3, 1\n\
            *ELEMENT, TYPE=S4\n1, 1, 2, 12, 11\n*ELGEN, ELSET=plate\n1, 3, 1, 1, 2, 10, 10\n";
        assert_eq!(shape(bias), shape(&plate(1, 0.0, [0.0, 1.0, 3.0, 7.0], "plate")));
    }

    #[test]
    fn an_old_deck_of_abaqus_is_read() {
        // A barrel vault as Abaqus's own examples are written: shells of eight nodes; and beams.
        let text = "*HEADING\n VAULT\n*NODE ,  SYSTEM=C,NSET=CORNER\n1 , 300.\n9 , 300. ,,300.\n801 , 300. , 40.\n\
            809 , 300. , 40. , 300.\n*NGEN,LINE=C,NSET=WALL\n1 ,801 , 100\n*NGEN,LINE=C, NSET=SYMM\n\
            9 ,809 , 100 ,,,, 300.\n*NFILL\nWALL,SYMM,8,1\n*ELEMENT,TYPE=S8R5   ,ELSET=ROOF\n\
            1,  1,3,203,201,  2,103,202,101\n*ELGEN,ELSET=ROOF\n1,4,2,1,4,200,10\n*ELEMENT,TYPE=B32\n91,1,2,3\n\
            *ELGEN,ELSET=RIBS\n91,4,2,1\n*SHELL SECTION,MATERIAL=R1,ELSET=ROOF\n3.0, 3\n";
        let scene = open(text).unwrap();
        assert_eq!((&*scene.objects.join(" "), scene.triangles.len()), ("ROOF", 64));
        let area: f64 = scene
            .triangles
            .iter()
            .map(|t| {
                (t.corners[1] - t.corners[0])
                    .cross(t.corners[2] - t.corners[0])
                    .length()
                    / 2.0
            })
            .sum();
        // Eight chords of 5 degrees, 300 long: the nodes at the middles of sides lie on the arc.
        let exact = 8.0 * 2.0 * 300.0 * 2.5_f64.to_radians().sin() * 300.0;
        assert!((area / exact - 1.0).abs() < 1e-12, "{area} {exact}");
    }

    #[test]
    fn decks_of_calculixs_tests_are_read() {
        // Surfaces of edges of plane elements, a node without coordinates, more nodes than the type has, a side of a
        // beam: plate.inp, planestress3.inp, beampsensfreq.inp and contact11.inp, in short.
        let plate = plate(1, 0.0, EVEN, "plate").replace("TYPE=S4", "TYPE=CPS4");
        let edges = plate.clone() + "*SURFACE, NAME=low\n1, S1\n2, S1\n";
        assert_eq!(shape(&edges), shape(&plate));
        assert!(
            open(&edges)
                .unwrap()
                .ledger
                .warnings
                .iter()
                .any(|warning| warning.contains("edges alone"))
        );
        let bare = plate.replace("1, 0, 0, 0\n", "1\n");
        assert_eq!(shape(&bare), shape(&plate));
        assert_eq!(
            shape(&plate.replace("1, 1, 2, 12, 11\n", "1, 1, 2, 12, 11, 3, 13,\n")),
            shape(&plate)
        );
        let solid = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n\
            *ELEMENT, TYPE=B31\n2, 1, 2\n*SURFACE, NAME=low\n1, S1\n*SURFACE, NAME=beam\n2, S2\n";
        assert_eq!(open(solid).unwrap().triangles.len(), 1);
        let message = open(&solid.replace("B31", "S3").replace("2, 1, 2\n", "3, 1, 2, 3\n"))
            .unwrap_err()
            .to_string();
        assert!(message.starts_with("line 13: element 2 is not there"), "{message}");
    }

    #[test]
    fn copies_are_those_written_out() {
        let low = plate(1, 0.0, EVEN, "low");
        let sets = "*NSET, NSET=corners, GENERATE\n1, 4\n*NSET, NSET=some\ncorners, 11, 12, 13, 14\n21, 22, 23, 24\n";
        let copy = |how: &str, reflect: &str| {
            format!(
                "{low}{sets}*NCOPY, CHANGE NUMBER=100, OLD SET=some, {how}\n\
                 *ELCOPY, ELEMENT SHIFT=100, SHIFT NODES=100, OLD SET=low, NEW SET=high{reflect}\n"
            )
        };
        let both = low.clone() + &plate(101, 3.0, EVEN, "high");
        assert_eq!(shape(&copy("SHIFT\n0, 0, 3", "")), shape(&both));
        // Half a turn about the line x = 3, y = 1, after the shift.
        assert_eq!(
            shape(&copy("SHIFT\n0, 0, 3\n3, 1, 0, 3, 1, 1, 180.", ""))
                .iter()
                .map(|(_, t)| t.iter().map(|p| p[2]).sum::<i64>())
                .sum::<i64>(),
            12 * 3 * 3_000_000
        );
        // A mirror at z = 1.5 turns the copies round, and REFLECT turns them back.
        let mirrored = copy("REFLECT=MIRROR\n0, 0, 1.5, 1, 0, 1.5\n0, 1, 1.5", ", REFLECT");
        let flipped = shape(&mirrored);
        assert_eq!(flipped.len(), shape(&both).len());
        let up = |text: &str| {
            let scene = open(text).expect("a good file");
            let area = |t: &crate::Triangle| (t.corners[1] - t.corners[0]).cross(t.corners[2] - t.corners[0]).z / 2.0;
            scene.triangles.iter().map(area).sum::<f64>()
        };
        assert!(up(&mirrored).abs() < 1e-9, "12 of area each way: {}", up(&mirrored));
        assert!((up(&mirrored.replace(", REFLECT\n", "\n")) - 24.0).abs() < 1e-9);
        let points = |text: &str, height: i64| {
            let of = shape(text).into_iter().flat_map(|(_, corners)| corners);
            let mut of: Vec<_> = of.filter(|p| p[2] == height).collect();
            of.sort_unstable();
            of.dedup();
            of
        };
        assert_eq!(points(&mirrored, 3_000_000), points(&both, 3_000_000));
    }

    #[test]
    fn arcs_systems_and_cylinders() {
        // A quarter of a cylinder of radius 2 about z, three ways.
        let by_radius = "*NODE, SYSTEM=C\n1, 2, 0, 0\n2, 2, 45, 0\n3, 2, 90, 0\n11, 2, 0, 1\n12, 2, 45, 1\n\
            13, 2, 90, 1\n*ELEMENT, TYPE=S4, ELSET=wall\n1, 1, 2, 12, 11\n2, 2, 3, 13, 12\n";
        let by_arc = "*NODE\n1, 2, 0, 0\n3, 0, 2, 0\n11, 2, 0, 1\n13, 0, 2, 1\n99, 0, 0, 1\n*NGEN, LINE=C\n\
            1, 3, 1, , 0, 0, 0\n11, 13, 1, 99\n*ELEMENT, TYPE=S4\n1, 1, 2, 12, 11\n*ELGEN, ELSET=wall\n1, 2\n";
        assert_eq!(shape(by_radius), shape(by_arc));
        // The system's x is the global y, its z is z; then it ends.
        let by_system = "*SYSTEM\n5, 0, 0, 5, 1, 0\n*NODE\n1, 0, 3, 0\n*SYSTEM\n*NODE\n2, 5, 0, 0\n3, 5, 1, 0\n\
            *ELEMENT, TYPE=S3, ELSET=wall\n1, 1, 2, 3\n";
        let plain = "*NODE\n1, 2, 0, 0\n2, 5, 0, 0\n3, 5, 1, 0\n*ELEMENT, TYPE=S3, ELSET=wall\n1, 1, 2, 3\n";
        assert_eq!(shape(by_system), shape(plain));
        // With a third point: x up, y along x, so that z is along y.
        let stands = "*SYSTEM\n0, 0, 0, 0, 0, 1\n1, 0, 0\n*NODE\n1, 0, 1, 0\n2, 0, 0, 0\n3, 2, 0, 3\n\
            *ELEMENT, TYPE=S3, ELSET=wall\n1, 1, 2, 3\n";
        let plain = "*NODE\n1, 1, 0, 0\n2, 0, 0, 0\n3, 0, 3, 2\n*ELEMENT, TYPE=S3, ELSET=wall\n1, 1, 2, 3\n";
        assert_eq!(shape(stands), shape(plain));
    }

    #[test]
    fn combined_surfaces_add_nothing() {
        let text = plate(1, 0.0, EVEN, "plate")
            + "*SURFACE, NAME=left\n1, SPOS\n*SURFACE, NAME=right\n3, SPOS\n*SURFACE, NAME=both, COMBINE=UNION\n\
               left, right\n*SURFACE, NAME=one, COMBINE=DIFFERENCE\nboth, left\n";
        let scene = open(&text).unwrap();
        assert_eq!((&*scene.objects.join(" "), scene.triangles.len()), ("left right", 4));
        let message = open(&text.replace("both, left", "both, middle"))
            .unwrap_err()
            .to_string();
        assert!(
            message.starts_with("line 28: surface `middle` is not there"),
            "{message}"
        );
    }

    #[test]
    fn what_no_rule_can_make_is_named() {
        let plate = plate(1, 0.0, EVEN, "plate");
        for (text, expected) in [
            ("*NGEN\n1, 9\n", "line 22: node 9 is not there"),
            (
                "*NGEN\n1, 4, 2\n",
                "line 22: nodes from 1 to 4 are not a step of 2 apart",
            ),
            ("*NGEN, LINE=P\n1, 4\n", "line 21: nodes along `LINE=P`"),
            ("*NGEN, LINE=C\n1, 4, 1, 2\n", "line 22: an arc of half a turn or more"),
            ("*NGEN, SYSTEM=S\n1, 4\n", "line 21: nodes in the system `S`"),
            ("*NFILL\nlow, high, 2\n", "line 22: node set `low` is not there"),
            (
                "*NSET, NSET=a\n1, 2\n*NSET, NSET=b\n3\n*NFILL\na, b, 2\n",
                "line 26: its sets have 2 and 1 nodes",
            ),
            (
                "*NSET, NSET=a, ELSET=plate\n*NFILL\na, a, 2\n",
                "line 23: its node set is made of",
            ),
            (
                "*NCOPY, OLD SET=a, SHIFT\n0, 0, 1\n",
                "line 21: `*NCOPY` without `CHANGENUMBER=`",
            ),
            (
                "*NCOPY, OLD SET=a, POLE, CHANGE NUMBER=9\n",
                "line 21: `*NCOPY` with `POLE`",
            ),
            (
                "*NCOPY, OLD SET=a, SHIFT, CHANGE NUMBER=9\n1\n",
                "line 21: node set `A` is not there",
            ),
            ("*ELGEN\n77, 2\n", "line 22: element 77 is not there"),
            ("*ELGEN\n1, 2, 10, 10\n", "line 22: element 11 is there twice"),
            (
                "*ELGEN\n1, 2, 1, 70\n1, 2, 50, 80\n",
                "line 23: element 81 has a corner at node 51",
            ),
            (
                "*ELCOPY, OLD SET=plate, SHIFT NODES=1\n",
                "line 21: `*ELCOPY` without `ELEMENTSHIFT=`",
            ),
            (
                "*SYSTEM\n0, 0, 0, 0, 0, 1\n",
                "line 21: the points of the system lie on one line",
            ),
            ("*NMAP, NSET=a\n", "line 21: `*NMAP` moves nodes"),
        ] {
            let message = open(&(plate.clone() + text)).unwrap_err().to_string();
            assert!(message.starts_with(expected), "{text}: {message}");
        }
        let many = open(&(plate.clone() + "*ELGEN\n1, 2000, 0, 100, 2000, 0, 200000\n")).unwrap_err();
        assert!(matches!(many.kind, ErrorKind::OverLimit(_)), "{many}");
        let long = plate + "*NSET, NSET=a, GENERATE\n1, 4\n" + &"*NCOPY, CHANGE NUMBER=0, OLD SET=a, SHIFT\n".repeat(9);
        assert!(open(&long).unwrap_err().to_string().contains("without data lines"));
    }
}
