//! Maps with coordinates: GeoTIFF, NetCDF and ESRI's ASCII grid, of one column of a grid's rows.
//!
//! A map's coordinates are along east and north, its first row is the northernmost, and a cell is an area. Sources:
//! *OGC GeoTIFF Standard 1.1* (19-008r4): tags 33550, 33922, 34735; GDAL's tags 42112 and 42113 for names of bands and
//! for what has no value; *NetCDF Climate and Forecast Conventions 1.8*, 5.6 on grid mappings.
//!
//! TIFF is compressed by LZW. No deflate, because zlib's bytes depend on the processor's instructions.

use super::crs::Crs;
use anyhow::{Context, Result, anyhow};
use glam::DVec2;
use netcdf_writer::{NcAttrValue, NcFileBuilder, NcWriteOptions};
use std::fmt::Write;
use tiff::encoder::{Compression, TiffEncoder, colortype::Gray32Float};
use tiff::tags::{ExtraSamples, Tag};

/// What stands in a cell without a value, in all formats: no view factor and no temperature.
pub(super) const NO_DATA: f32 = -9999.0;
/// GDAL's metadata of a file.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Keys of GeoTIFF and their values: the model is projected, a cell is an area, and the code of the system.
const MODEL_TYPE: u16 = 1024;
const PROJECTED: u16 = 1;
const RASTER_TYPE: u16 = 1025;
const IS_AREA: u16 = 1;
const PROJECTED_CRS: u16 = 3072;

/// A band: one, or a cube's side each.
pub(super) struct Band {
    /// The side of a cube; otherwise empty.
    pub(super) side: &'static str,
    /// Row by row from the north, each from the west.
    pub(super) values: Vec<f32>,
}

/// A column of a grid's rows as a map.
pub(super) struct Map {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// The lower left corner, and the edge of a cell.
    pub(super) corner: DVec2,
    pub(super) step: f64,
    pub(super) bands: Vec<Band>,
    /// What it is, in words, as a name of letters and `_`, and its unit.
    pub(super) title: String,
    pub(super) variable: &'static str,
    pub(super) units: &'static str,
    pub(super) crs: Option<Crs>,
}

impl Map {
    /// Bytes of the bands, and of a file in memory.
    pub(super) fn bytes(columns: usize, rows: usize, bands: usize) -> u64 {
        // An ASCII grid has some 12 characters a number.
        16 * columns as u64 * rows as u64 * bands as u64
    }

    fn top(&self) -> f64 {
        self.corner.y + self.rows as f64 * self.step
    }

    fn name(&self, band: &Band) -> String {
        match band.side {
            "" => self.title.clone(),
            side => format!("{}: {side}", self.title),
        }
    }

    /// A GeoTIFF of 32-bit real numbers, a band for each side of a cube.
    pub(super) fn tiff(&self) -> Result<Vec<u8>> {
        let size = |cells: usize| u32::try_from(cells).context("too many cells");
        let mut file = std::io::Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new(&mut file)?.with_compression(Compression::Lzw);
        let mut image = encoder.new_image::<Gray32Float>(size(self.columns)?, size(self.rows)?)?;
        if self.bands.len() > 1 {
            image.extra_samples(&vec![ExtraSamples::Unspecified; self.bands.len() - 1])?;
        }
        let tags = image.encoder();
        tags.write_tag(Tag::ModelPixelScaleTag, &[self.step, self.step, 0.0][..])?;
        let tie = [0.0, 0.0, 0.0, self.corner.x, self.top(), 0.0];
        tags.write_tag(Tag::ModelTiepointTag, &tie[..])?;
        let mut keys = vec![[RASTER_TYPE, 0, 1, IS_AREA]];
        if let Some(crs) = &self.crs {
            keys.insert(0, [MODEL_TYPE, 0, 1, PROJECTED]);
            keys.push([PROJECTED_CRS, 0, 1, crs.code]);
        }
        let version = [1, 1, 0, u16::try_from(keys.len())?];
        let directory: Vec<u16> = std::iter::once(version).chain(keys).flatten().collect();
        tags.write_tag(Tag::GeoKeyDirectoryTag, &directory[..])?;
        tags.write_tag(Tag::GdalNodata, &*NO_DATA.to_string())?;
        tags.write_tag(GDAL_METADATA, &*self.gdal_metadata()?)?;
        let bands = &self.bands;
        let cells = 0..self.columns * self.rows;
        let values: Vec<f32> = cells
            .flat_map(|cell| bands.iter().map(move |band| band.values[cell]))
            .collect();
        image.write_data(&values)?;
        Ok(file.into_inner())
    }

    /// The bands' names, in ASCII as the tag asks. GDAL escapes a name, and then the text of the item.
    fn gdal_metadata(&self) -> Result<String> {
        let mut text = "<GDALMetadata>\n".to_owned();
        for (at, band) in self.bands.iter().enumerate() {
            write!(
                text,
                "  <Item name=\"DESCRIPTION\" sample=\"{at}\" role=\"description\">"
            )?;
            for letter in self.name(band).chars() {
                match letter {
                    '<' => text.push_str("&amp;lt;"),
                    '>' => text.push_str("&amp;gt;"),
                    '&' => text.push_str("&amp;amp;"),
                    // XML has no other control characters.
                    _ if letter.is_control() => text.push(' '),
                    _ if letter.is_ascii() => text.push(letter),
                    _ => write!(text, "&#{};", u32::from(letter))?,
                }
            }
            text.push_str("</Item>\n");
        }
        text.push_str("</GDALMetadata>\n");
        Ok(text)
    }

    /// An ASCII grid of one band.
    pub(super) fn ascii_grid(&self) -> Result<Vec<u8>> {
        let [band] = &self.bands[..] else {
            return Err(anyhow!("an ASCII grid has one band"));
        };
        let mut text = format!(
            "ncols {}\nnrows {}\nxllcorner {}\nyllcorner {}\ncellsize {}\nNODATA_value {NO_DATA}\n",
            self.columns, self.rows, self.corner.x, self.corner.y, self.step
        );
        for row in band.values.chunks(self.columns) {
            for (column, value) in row.iter().enumerate() {
                let blank = if column == 0 { "" } else { " " };
                write!(text, "{blank}{value}")?;
            }
            text.push('\n');
        }
        Ok(text.into_bytes())
    }

    /// A NetCDF file in the classic form by the Climate and Forecast Conventions.
    pub(super) fn netcdf(&self) -> Result<Vec<u8>> {
        let text = |text: &str| NcAttrValue::Chars(text.to_owned());
        let mut file = NcFileBuilder::new();
        file.add_attribute("Conventions", text("CF-1.8"))?;
        file.add_attribute("title", text(&self.title))?;
        file.add_attribute("source", text(concat!("hemicube ", env!("CARGO_PKG_VERSION"))))?;
        let y = file.add_dimension("y", self.rows as u64)?;
        let x = file.add_dimension("x", self.columns as u64)?;
        let mut shape = vec![y, x];
        if self.bands.len() > 1 {
            let side = file.add_dimension("side", self.bands.len() as u64)?;
            // Numbers with meanings: GDAL takes names in letters for another raster, and then shows neither.
            let numbers: Vec<i32> = (0..).take(self.bands.len()).collect();
            let names: Vec<&str> = self.bands.iter().map(|band| band.side).collect();
            let axis = file.add_variable::<i32>("side", &[side])?;
            file.add_variable_attribute(axis, "long_name", text("side of the cube"))?;
            file.add_variable_attribute(axis, "flag_values", NcAttrValue::Ints(numbers.clone()))?;
            file.add_variable_attribute(axis, "flag_meanings", text(&names.join(" ")))?;
            file.write_variable(axis, &numbers)?;
            shape.insert(0, side);
        }
        let middles = |first: f64, step: f64, count: usize| -> Vec<f64> {
            (0..count).map(|cell| first + (cell as f64 + 0.5) * step).collect()
        };
        for (name, dimension, values) in [
            ("y", y, middles(self.top(), -self.step, self.rows)),
            ("x", x, middles(self.corner.x, self.step, self.columns)),
        ] {
            let axis = file.add_variable::<f64>(name, &[dimension])?;
            let standard = format!("projection_{name}_coordinate");
            file.add_variable_attribute(axis, "standard_name", text(&standard))?;
            file.add_variable_attribute(axis, "axis", text(&name.to_uppercase()))?;
            if let Some(crs) = &self.crs {
                file.add_variable_attribute(axis, "units", text(crs.unit))?;
            }
            file.write_variable(axis, &values)?;
        }
        let column = file.add_variable::<f32>(self.variable, &shape)?;
        file.set_variable_fill_value(column, NO_DATA)?;
        file.add_variable_attribute(column, "long_name", text(&self.title))?;
        file.add_variable_attribute(column, "units", text(self.units))?;
        if let Some(crs) = &self.crs {
            file.add_variable_attribute(column, "grid_mapping", text("crs"))?;
            let mapping = file.add_variable::<i32>("crs", &[])?;
            file.add_variable_attribute(mapping, "crs_wkt", text(crs.wkt))?;
            // The name that GDAL has for it, and with it for the corner and the cell.
            file.add_variable_attribute(mapping, "spatial_ref", text(crs.wkt))?;
            let transform = format!("{} {} 0 {} 0 {}", self.corner.x, self.step, self.top(), -self.step);
            file.add_variable_attribute(mapping, "GeoTransform", text(&transform))?;
            file.write_variable(mapping, &[0i32])?;
        }
        let values: Vec<f32> = self.bands.iter().flat_map(|band| &band.values).copied().collect();
        file.write_variable(column, &values)?;
        let (_, bytes) = file.to_vec(NcWriteOptions::default())?;
        Ok(bytes)
    }
}
