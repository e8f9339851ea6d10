//! Makes a scene of a model: places instances, resolves sets and surfaces.

use super::model::{Instance, Label, Members, Model, NONE, Sides};
use super::shown;
use crate::bounds::{Bounds, STEPS_A_COPY};
use crate::mesh::{Mesh, Shape, Side, Tags};
use crate::names::Names;
use crate::polygon::Labels;
use crate::{Error, ErrorKind, Fate, Kind as Lost, Scene};
use glam::DAffine3;
use std::collections::{BTreeMap, HashSet};

/// No object yet.
const FREE: u32 = u32::MAX;

/// Returns whether Gmsh made a name, for the elements of an entity of its model: `Surface7`. Groups that a person named
/// follow in its files, and go before it.
fn is_of_an_entity(name: &str) -> bool {
    let number = ["Surface", "Volume"].iter().find_map(|kind| name.strip_prefix(kind));
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit()))
}

pub(super) fn scene(mut model: Model, bounds: Bounds) -> Result<Scene, Error> {
    place_parts(&mut model);
    let numbers: Result<Vec<Tags>, Error> = model
        .parts
        .iter()
        .map(|part| tags(&model, &part.numbers, &part.lines, "element"))
        .collect();
    let mut resolver = Resolver {
        numbers: numbers?,
        first_cells: Vec::new(),
        model,
        bounds,
        mesh: Mesh::default(),
    };
    resolver.mesh.ledger = std::mem::take(&mut resolver.model.ledger);
    if resolver.cell_count()? == 0 {
        return Err(Error::malformed(
            "has no shells and no solids; the file is cut short, or its mesh is in another one that it includes",
        ));
    }
    let materials = resolver.materials()?;
    if resolver.model.sides.is_empty() {
        let objects = resolver.objects()?;
        resolver.cells(&objects, &materials)?;
        drop(resolver.model);
        return resolver.mesh.scene(resolver.bounds);
    }
    let cells = resolver.cell_count()?;
    let before = resolver.mesh.ledger.clone();
    resolver.cells(&vec![0; cells], &materials)?;
    let sides = resolver.sides()?;
    let in_plane = (0..resolver.mesh.len()).any(|cell| resolver.mesh.shape(cell) == Some(Shape::Polygon));
    if sides.is_empty() && in_plane {
        let materials_of = std::mem::take(&mut resolver.mesh.materials);
        resolver.mesh = Mesh::default();
        (resolver.mesh.ledger, resolver.mesh.materials) = (before, materials_of);
        let warning = "surfaces of edges alone, of elements in a plane, are left out, and the elements read";
        resolver.mesh.ledger.warnings.push(warning.to_owned());
        let objects = resolver.objects()?;
        resolver.cells(&objects, &materials)?;
        drop(resolver.model);
        return resolver.mesh.scene(resolver.bounds);
    }
    drop(resolver.model);
    resolver.mesh.scene_of(&sides, resolver.bounds)
}

/// Places parts where they stand, if there is no instance.
fn place_parts(model: &mut Model) {
    if model.instances.len() > 1 {
        return;
    }
    let mut names: Vec<(u32, &String)> = model.part_names.iter().map(|(name, &part)| (part, name)).collect();
    names.sort_unstable();
    model.instances.extend(names.into_iter().map(|(part, name)| Instance {
        name: name.clone(),
        part,
        place: DAffine3::IDENTITY,
    }));
}

/// The table of numbers of nodes or elements.
fn tags(model: &Model, numbers: &[u32], lines: &[u32], what: &str) -> Result<Tags, Error> {
    let wide: Vec<u64> = numbers.iter().map(|&number| u64::from(number)).collect();
    Tags::new(&wide).map_err(|number| {
        let at = wide.iter().rposition(|&other| other == number);
        let line = at.and_then(|at| lines.get(at)).copied().unwrap_or(0);
        model.fail(line, format!("{what} {number} is there twice"))
    })
}

struct Resolver {
    model: Model,
    /// Elements by number, of each part.
    numbers: Vec<Tags>,
    /// The number of each instance's first cell in the mesh.
    first_cells: Vec<u32>,
    bounds: Bounds,
    mesh: Mesh,
}

fn too_many() -> Error {
    Error::new(ErrorKind::TooLarge(
        "has more nodes or elements than can be numbered".to_owned(),
    ))
}

/// Bytes of a name beside its text, in tables and as an object.
const NAME: u64 = 96;
/// Bytes of a node of an instance, with the table of the numbers of its part's.
const NODE: u64 = 24;

/// Bound of the further sets that elements are in, in all: four bytes each. A choice: a million elements in sixteen sets.
const MOST_MEMBERSHIPS: u64 = 1 << 24;

impl Resolver {
    /// Counts cells, and where those of each instance begin.
    fn cell_count(&mut self) -> Result<usize, Error> {
        let mut count = 0_usize;
        self.first_cells.clear();
        for instance in &self.model.instances {
            self.first_cells.push(u32::try_from(count).map_err(|_| too_many())?);
            let part = self.model.parts.get(instance.part as usize);
            count = count.saturating_add(part.map_or(0, |part| part.numbers.len()));
        }
        self.bounds.triangles(count as u64, 0)?;
        Ok(count)
    }

    /// The cells of the members of a set, in order and once each.
    fn members(&mut self, last: u32, instance: u32) -> Result<Vec<u32>, Error> {
        let mut cells = Vec::new();
        let mut pending = vec![(last, instance)];
        let mut visited = HashSet::new();
        let mut steps = 0;
        while let Some((entry, instance)) = pending.pop() {
            if !visited.insert((entry, instance)) {
                continue;
            }
            let Some(&entry) = self.model.entries.get(entry as usize) else {
                continue;
            };
            if entry.before != NONE {
                pending.push((entry.before, instance));
            }
            let of = if entry.instance == NONE {
                instance
            } else {
                entry.instance
            } as usize;
            let Some(part) = self.model.instances.get(of).map(|instance| instance.part as usize) else {
                continue;
            };
            let (Some(&first), Some(numbers)) = (self.first_cells.get(of), self.numbers.get(part)) else {
                continue;
            };
            let pool = self.model.pool.get(entry.begin as usize..entry.end as usize);
            let pool = if entry.members == Members::Places {
                &[]
            } else {
                pool.unwrap_or_default()
            };
            let before = cells.len() + pending.len();
            match entry.members {
                Members::Places => cells.extend((entry.begin..entry.end).map(|place| first + place)),
                Members::Numbers => {
                    for &number in pool {
                        match numbers.place(u64::from(number)) {
                            Some(place) => cells.push(first + place),
                            None => self.mesh.ledger.note("element in a set that is not there"),
                        }
                    }
                    steps += pool.len();
                }
                Members::Ranges => {
                    for range in pool.as_chunks::<3>().0 {
                        let [begin, end, step] = range.map(u64::from);
                        let within = numbers.within(begin, end);
                        let hit = within.iter().filter(|(number, _)| (number - begin) % step == 0);
                        cells.extend(hit.map(|&(_, place)| first + place));
                        steps += 1 + within.len();
                    }
                }
                Members::Sets => {
                    let inner = |&[last, of]: &[u32; 2]| (last, if of == NONE { instance } else { of });
                    pending.extend(pool.as_chunks::<2>().0.iter().map(inner));
                }
            }
            steps += (cells.len() + pending.len()).saturating_sub(before);
            let spent = STEPS_A_COPY + std::mem::take(&mut steps) as u64;
            self.bounds.steps(spent).map_err(|_| {
                Error::new(ErrorKind::TooLarge(
                    "sets of elements that hold each other take too long to be resolved; list their elements once"
                        .to_owned(),
                ))
            })?;
        }
        cells.sort_unstable();
        cells.dedup();
        Ok(cells)
    }

    /// The instances of a part: itself, for what stands outside parts. Each is one more copy to look at.
    fn instances(&mut self, part: u32) -> Result<Vec<u32>, Error> {
        let found = self.instances_of(part);
        let steps = self.model.instances.len() as u64 + STEPS_A_COPY * found.len() as u64;
        self.bounds.steps(steps).map_err(|_| {
            Error::new(ErrorKind::OverLimit(
                "sets, surfaces and sections, each of many instances, take too long to be resolved; place fewer copies"
                    .to_owned(),
            ))
        })?;
        Ok(found)
    }

    fn instances_of(&self, part: u32) -> Vec<u32> {
        let is_of = |&at: &u32| {
            self.model
                .instances
                .get(at as usize)
                .is_some_and(|found| found.part == part)
        };
        (0..u32::try_from(self.model.instances.len()).unwrap_or(NONE))
            .filter(is_of)
            .collect()
    }

    /// A name, with its instance's before it where there are several.
    fn named(&mut self, instance: u32, name: &str) -> Result<String, Error> {
        let prefix = self.model.instances.get(instance as usize);
        let prefix = prefix.map_or(0, |instance| instance.name.len());
        self.bounds.copied(NAME + (name.len() + prefix) as u64)?;
        Ok(match self.model.instances.get(instance as usize) {
            Some(instance) if !instance.name.is_empty() && self.model.instances.len() > 2 => {
                format!("{}.{name}", instance.name)
            }
            _ => name.to_owned(),
        })
    }

    /// The material of each cell, as numbers of names.
    fn materials(&mut self) -> Result<Vec<u32>, Error> {
        let cells = self.cell_count()?;
        let none = self.mesh.materials.number("")?;
        let mut materials = vec![FREE; cells];
        for section in std::mem::take(&mut self.model.sections) {
            let Some((set, of)) = self.model.set(section.scope, &section.set) else {
                continue;
            };
            let material = self.mesh.materials.number(&section.material)?;
            let last = self.model.sets[set as usize].last;
            let instances = if of == NONE {
                self.instances(section.scope)?
            } else {
                vec![of]
            };
            for instance in instances {
                for cell in self.members(last, instance)? {
                    let material_of = &mut materials[cell as usize];
                    if *material_of == FREE {
                        *material_of = material;
                    }
                }
            }
        }
        materials
            .iter_mut()
            .filter(|material| **material == FREE)
            .for_each(|material| *material = none);
        Ok(materials)
    }

    /// The object of each cell by the sets that hold it, as numbers of names.
    fn objects(&mut self) -> Result<Vec<u32>, Error> {
        let cells = self.cell_count()?;
        let mut objects = vec![FREE; cells];
        let mut names = Names::default();
        let mut late = Vec::new();
        // The further sets of elements that several list.
        let mut further: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        let mut memberships = 0u64;
        for pass in 0..3 {
            let sets: Vec<usize> = match pass {
                0 | 1 => (0..self.model.sets.len()).collect(),
                _ => std::mem::take(&mut late),
            };
            for at in sets {
                let set = &self.model.sets[at];
                let is_named = set.lists || set.of_elements && !is_of_an_entity(&set.name);
                let due = match pass {
                    0 => is_named && !set.internal,
                    1 => set.of_elements && !set.lists && (set.internal || !is_named),
                    _ => true,
                };
                if !due {
                    if pass == 0 && !set.of_elements && !set.internal {
                        late.push(at);
                    }
                    continue;
                }
                let (last, scope, name) = (set.last, set.scope, set.name.clone());
                for instance in self.instances(scope)? {
                    let members = self.members(last, instance)?;
                    // A set of all elements tells nothing apart.
                    if pass < 2 && members.len() == cells {
                        late.push(at);
                        continue;
                    }
                    let free = |cell: &&u32| objects[**cell as usize] == FREE;
                    let count = members.iter().filter(free).count();
                    if count == 0 && pass > 0 {
                        continue;
                    }
                    let object = names.number(&self.named(instance, &name)?)?;
                    for cell in members {
                        let object_of = &mut objects[cell as usize];
                        if *object_of == FREE {
                            *object_of = object;
                        } else if pass == 0 {
                            memberships += 1;
                            if memberships > MOST_MEMBERSHIPS {
                                return Err(Error::new(ErrorKind::TooLarge(format!(
                                    "elements in more than {MOST_MEMBERSHIPS} further sets in all take too long to be \
                                     resolved; keep the sets that name surfaces"
                                ))));
                            }
                            further.entry(cell as usize).or_default().push(object);
                        }
                    }
                }
            }
        }
        self.rest(&mut objects, &mut names)?;
        // In the order of the elements.
        let mut last: Option<(Vec<u32>, u32)> = None;
        for (cell, object) in objects.iter_mut().enumerate() {
            let others = further.remove(&cell).unwrap_or_default();
            let key: Vec<u32> = std::iter::once(*object).chain(others).collect();
            *object = match &last {
                Some((before, number)) if *before == key => *number,
                _ => {
                    let names: Vec<String> = key.iter().map(|&name| names.names[name as usize].clone()).collect();
                    let number = self.mesh.object(&names)?;
                    last = Some((key, number));
                    number
                }
            };
        }
        Ok(objects)
    }

    /// Names the elements of no set.
    fn rest(&self, objects: &mut [u32], names: &mut Names) -> Result<(), Error> {
        for at in 0..self.model.instances.len() {
            let first = self.first_cells[at] as usize;
            let end = self.first_cells.get(at + 1).map_or(objects.len(), |&end| end as usize);
            let mut free = objects[first..end]
                .iter_mut()
                .filter(|object| **object == FREE)
                .peekable();
            if free.peek().is_none() {
                continue;
            }
            let name = &self.model.instances[at].name;
            let object = names.number(if name.is_empty() { "elements" } else { name })?;
            free.for_each(|free| *free = object);
        }
        Ok(())
    }

    /// Puts the nodes and elements of all instances into the mesh.
    fn cells(&mut self, objects: &[u32], materials: &[u32]) -> Result<(), Error> {
        let mut face = 0;
        // A part that stands in one place is no copy.
        let mut placed = vec![false; self.model.parts.len()];
        for instance in &self.model.instances {
            let part = &self.model.parts[instance.part as usize];
            if part.numbers.is_empty() {
                continue;
            }
            let base = u32::try_from(self.mesh.nodes.len()).map_err(|_| too_many())?;
            if placed[instance.part as usize] {
                self.bounds.copied(NODE * part.nodes.len() as u64)?;
            }
            placed[instance.part as usize] = true;
            let nodes = tags(&self.model, &part.node_numbers, &part.node_lines, "node")?;
            self.mesh
                .nodes
                .extend(part.nodes.iter().map(|&node| instance.place.transform_point3(node)));
            for (at, block) in part.blocks.iter().enumerate() {
                let next = part.blocks.get(at + 1);
                let end = next.map_or(part.numbers.len(), |next| next.first as usize);
                let count = block.kind.used();
                let corner_count = usize::from(block.kind.corners);
                let corners = part.corners[block.first_corner as usize..].chunks_exact(count);
                for (element, corners) in (block.first as usize..end).zip(corners) {
                    let mut places = [0; 20];
                    for (place, &number) in places.iter_mut().zip(corners) {
                        let found = nodes.place(u64::from(number)).and_then(|place| place.checked_add(base));
                        *place = found.ok_or_else(|| {
                            self.model.fail(
                                part.lines[element],
                                format!(
                                    "element {} has a corner at node {number}, which is not there",
                                    part.numbers[element]
                                ),
                            )
                        })?;
                    }
                    let labels = Labels {
                        object: objects[face as usize],
                        material: materials[face as usize],
                        face,
                    };
                    let (corners, others) = places[..count].split_at(corner_count);
                    let edges = match block.kind.shape {
                        Shape::Polygon => corner_count,
                        shape => shape.edges().len(),
                    };
                    let (mids, centre) = others.split_at(edges.min(others.len()));
                    self.mesh
                        .push_second(block.kind.shape, corners, mids, centre.first().copied(), labels)?;
                    face += 1;
                }
            }
        }
        Ok(())
    }

    /// The sides of all surfaces in their order, each once.
    fn sides(&mut self) -> Result<Vec<Side>, Error> {
        let mut taken = vec![0_u8; self.mesh.len()];
        let mut sides = Vec::new();
        let mut boundary: Option<Vec<(usize, usize)>> = None;
        for lines in std::mem::take(&mut self.model.sides) {
            let surface = &self.model.surfaces[lines.surface as usize];
            let (name, scope) = (surface.name.clone(), surface.scope);
            for instance in self.instances(scope)? {
                let cells = self.target(&lines, scope, instance)?;
                let named = self.named(instance, &name)?;
                let object = self.mesh.objects.number(&named)?;
                let of_several = Lost {
                    fate: Fate::Merged,
                    what: "side of several surfaces, put into the first",
                    next: "name each side in one surface",
                };
                let surface = self.model.surfaces[lines.surface as usize].name.clone();
                let mut add = |cell: u32, side: u8, ledger: &mut crate::Ledger| {
                    let bit = 1 << side;
                    let taken = &mut taken[cell as usize];
                    if *taken & bit != 0 {
                        ledger.lose(of_several, 1, None, || format!("surface `{}`", shown(&surface)));
                    } else {
                        *taken |= bit;
                        sides.push(Side { cell, side, object });
                    }
                };
                for &cell in &cells {
                    if let Some(side) = self.side(&lines, cell)? {
                        add(cell, side, &mut self.mesh.ledger);
                    }
                }
                if lines.label == Label::None {
                    let boundary = boundary.get_or_insert_with(|| self.mesh.boundary());
                    for &(cell, side) in boundary.iter() {
                        if let (Ok(cell), Ok(side)) = (u32::try_from(cell), u8::try_from(side))
                            && cells.binary_search(&cell).is_ok()
                        {
                            add(cell, side, &mut self.mesh.ledger);
                        }
                    }
                }
            }
        }
        let unused =
            (0..self.mesh.len()).filter(|&cell| self.mesh.shape(cell) == Some(Shape::Polygon) && taken[cell] == 0);
        let unused = unused.count() as u64;
        let kind = Lost {
            fate: Fate::LeftOut,
            what: "shell of no surface, left out",
            next: "name its sides in a surface, or take the surfaces away, so that all shells are read",
        };
        let is_unused = |&cell: &usize| self.mesh.shape(cell) == Some(Shape::Polygon) && taken[cell] == 0;
        let first = (0..self.mesh.len()).find(is_unused).unwrap_or(0);
        self.mesh.ledger.lose(kind, unused, None, || format!("cell {first}"));
        Ok(sides)
    }

    /// The cells that a line of a surface names, in order.
    fn target(&mut self, lines: &Sides, scope: u32, instance: u32) -> Result<Vec<u32>, Error> {
        let (of, number) = match self.model.instance_and(&lines.target) {
            Some((of, rest)) => (of, rest),
            None => (instance, lines.target.as_str()),
        };
        if let Ok(number) = number.parse::<u64>() {
            let part = self
                .model
                .instances
                .get(of as usize)
                .map_or(0, |found| found.part as usize);
            let place = self.numbers.get(part).and_then(|numbers| numbers.place(number));
            let first = self.first_cells.get(of as usize).copied();
            return match (place, first) {
                (Some(place), Some(first)) => Ok(vec![first + place]),
                _ if self.model.others.contains(&u32::try_from(part).unwrap_or(NONE)) => {
                    let kind = Lost {
                        fate: Fate::LeftOut,
                        what: "side of an element of another type, left out",
                        next: "shells and solids are read",
                    };
                    let line = self.line_of(lines.line);
                    self.mesh.ledger.lose(kind, 1, None, || line);
                    Ok(Vec::new())
                }
                _ => Err(self.model.fail(lines.line, format!("element {number} is not there"))),
            };
        }
        let Some((set, of)) = self.model.set(scope, &lines.target) else {
            let reason = format!("set `{}` is not there", shown(&lines.target));
            return Err(self.model.fail(lines.line, reason));
        };
        let last = self.model.sets[set as usize].last;
        self.members(last, if of == NONE { instance } else { of })
    }

    /// A line for a person.
    fn line_of(&self, line: u32) -> String {
        let error = self.model.fail(line, "");
        error
            .line
            .map_or_else(|| format!("line {line}"), |line| format!("line {line}"))
    }

    /// The side of a cell by a label; none for an edge, and for solids without a label.
    fn side(&mut self, lines: &Sides, cell: u32) -> Result<Option<u8>, Error> {
        let shape = self.mesh.shape(cell as usize).unwrap_or(Shape::Polygon);
        let plane = self.is_plane(cell);
        let count = shape.sides().len();
        let side = match (shape, lines.label) {
            (Shape::Polygon, Label::Back) => Some(0),
            (Shape::Polygon, Label::Front | Label::None) => Some(1),
            (Shape::Polygon, Label::Side(1)) if !plane => Some(0),
            (Shape::Polygon, Label::Side(2)) if !plane => Some(1),
            (Shape::Polygon, _) => {
                self.mesh.ledger.note("edge of a shell in a surface, left out");
                None
            }
            (_, Label::None) => None,
            (_, Label::Side(number)) if usize::from(number) <= count => Some(number - 1),
            _ => {
                return Err(self.model.fail(
                    lines.line,
                    format!("the label is none of this element's sides: a solid of this type has S1 to S{count}"),
                ));
            }
        };
        Ok(side)
    }

    /// Returns whether a cell is an element of the plane.
    fn is_plane(&self, cell: u32) -> bool {
        let instance = self
            .first_cells
            .partition_point(|&first| first <= cell)
            .saturating_sub(1);
        let Some(instance) = self.model.instances.get(instance) else {
            return false;
        };
        let part = &self.model.parts[instance.part as usize];
        let at = self
            .first_cells
            .partition_point(|&first| first <= cell)
            .saturating_sub(1);
        let place = cell - self.first_cells.get(at).copied().unwrap_or(0);
        let block = part.blocks.partition_point(|block| block.first <= place).checked_sub(1);
        block
            .and_then(|block| part.blocks.get(block))
            .is_some_and(|block| block.kind.plane)
    }
}
