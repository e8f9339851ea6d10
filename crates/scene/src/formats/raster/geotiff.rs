//! GeoTIFF: the first image of a TIFF, one band of heights, or two with the ground's, or three with the canopy's.

use super::{Raster, cells_of};
use crate::formats::parse_xml;
use crate::{Error, ReadOptions};
use std::fs::File;
use std::io::{BufReader, Cursor, Read, Seek};
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Keys of a GeoTIFF, and what they say.
const MODEL_TYPE: u16 = 1024;
const GEOGRAPHIC: u16 = 2;
const RASTER_TYPE: u16 = 1025;
const IS_POINT: u16 = 2;
const PROJECTED_CRS: u16 = 3072;
const USER_DEFINED: u16 = 32767;
/// The tag of GDAL's metadata, an XML text.
const GDAL_METADATA: u16 = 42112;
/// The bit of `NewSubfileType` of a mask, by TIFF 6.0.
const IS_MASK: u32 = 4;
/// Images of a file that may be a mask: overviews are some ten.
const IMAGES_MAX: u32 = 64;

type Image<'a> = Decoder<Cursor<&'a [u8]>>;

/// What the crate says of a file, as the end of a sentence.
fn wrong(error: TiffError) -> Error {
    match error {
        TiffError::UnsupportedError(what) => Error::unsupported(format!(
            "is a TIFF of a kind that is not read: {what}; `gdal_translate -co COMPRESS=LZW` makes one that is"
        )),
        error => Error::malformed(format!("is no TIFF as it should be: {error}")),
    }
}

/// Returns whether a TIFF has up to three bands of reals, or one or two of more than eight bits and a place of its
/// cells. Pictures are of integers: reals without a place are heights that lack it, which reading them says.
pub(super) fn has_heights(path: &Path) -> Result<bool, TiffError> {
    let mut image = Decoder::new(BufReader::new(File::open(path)?))?;
    let (bits, bands) = match image.colortype()? {
        ColorType::Gray(bits) => (bits, 1),
        ColorType::GrayA(bits) => (bits, 2),
        ColorType::Multiband { bit_depth, num_samples } => (bit_depth, num_samples),
        _ => return Ok(false),
    };
    let has_place =
        image.find_tag(Tag::ModelPixelScaleTag)?.is_some() || image.find_tag(Tag::ModelTransformationTag)?.is_some();
    Ok(bands <= 3 && is_of_reals(&mut image)? || bands <= 2 && bits > 8 && has_place)
}

/// Returns whether values of an image are real numbers.
fn is_of_reals<R: Read + Seek>(image: &mut Decoder<R>) -> Result<bool, TiffError> {
    /// IEEE floating point, by TIFF 6.0.
    const REAL: u16 = 3;
    let formats = image
        .find_tag_unsigned_vec::<u16>(Tag::SampleFormat)?
        .unwrap_or_default();
    Ok(!formats.is_empty() && formats.iter().all(|&format| format == REAL))
}

/// Reads a GeoTIFF.
pub(super) fn read(bytes: &[u8], options: ReadOptions) -> Result<Raster, Error> {
    let mut image = Decoder::new(Cursor::new(bytes)).map_err(wrong)?;
    let (columns, rows) = image.dimensions().map_err(wrong)?;
    let bands = match image.colortype().map_err(wrong)? {
        ColorType::Gray(_) | ColorType::Multiband { num_samples: 1, .. } => 1,
        ColorType::GrayA(_) | ColorType::Multiband { num_samples: 2, .. } => 2,
        ColorType::Multiband { num_samples: 3, .. } if is_of_reals(&mut image).map_err(wrong)? => 3,
        _ => {
            return Err(Error::unsupported(
                "is a picture or has other bands; a height model has one band, or the ground's height as a second one, or \
                 the canopy's above that as a third one, of real numbers",
            ));
        }
    };
    let planes: Option<u16> = image.find_tag_unsigned(Tag::PlanarConfiguration).map_err(wrong)?;
    if bands > 1 && planes == Some(2) {
        return Err(Error::unsupported(
            "has its bands one after the other; `gdal_translate -co INTERLEAVE=PIXEL` puts them side by side",
        ));
    }
    let [columns, rows] = cells_of(columns.into(), rows.into(), options)?;
    let cells = columns * rows;
    if bands == 3 {
        // The canopy, the crown of each cell, and rectangles of crowns.
        let bytes = 128 * cells as u64;
        options
            .budget
            .require(bytes, format!("a height model with a canopy of {cells} cells"))?;
    }
    let mut place = Place::of(&mut image)?;
    let none = match image.find_tag(Tag::GdalNodata).map_err(wrong)? {
        Some(text) => text.into_string().map_err(wrong)?.trim().parse::<f64>().ok(),
        None => None,
    };
    // A value is kept as text, and a height of 32 bits is the nearest of that.
    #[allow(clippy::cast_possible_truncation, reason = "as the file's own numbers")]
    let is_none = |height: f64| none.is_some_and(|none| height == none || height == f64::from(none as f32));
    let scaling = Scaling::of(&mut image, bands)?;
    let all = reals(image.read_image().map_err(wrong)?)?;
    require_no_mask(&mut image)?;
    if all.len() != cells * bands {
        return Err(Error::malformed(format!("has {} values for {cells} cells", all.len())));
    }
    let mut found: Vec<Vec<f64>> = (0..bands)
        .map(|band| {
            let values = all.iter().skip(band).step_by(bands);
            let height = |&value: &f64| {
                if is_none(value) {
                    f64::NAN
                } else {
                    scaling[band].height(value)
                }
            };
            values.map(height).collect()
        })
        .collect();
    let mut further = found.split_off(1).into_iter();
    let (ground, canopy) = (further.next(), further.next());
    Ok(Raster {
        columns,
        rows,
        west: place.west,
        north: place.north,
        cell: place.cell,
        heights: found.swap_remove(0),
        ground,
        canopy,
        crs: place.crs.take(),
    })
}

/// What makes heights of a band's values: value · scale + offset, as GDAL writes them beside a TIFF's tags.
#[derive(Clone, Copy)]
struct Scaling {
    scale: f64,
    offset: f64,
}

impl Scaling {
    /// Of each band, by the items of role `scale` and `offset` in `GDAL_METADATA`.
    fn of(image: &mut Image<'_>, bands: usize) -> Result<Vec<Self>, Error> {
        let mut found = vec![
            Self {
                scale: 1.0,
                offset: 0.0
            };
            bands
        ];
        let Some(text) = image.find_tag(Tag::Unknown(GDAL_METADATA)).map_err(wrong)? else {
            return Ok(found);
        };
        // Metadata of other programs may be in any form, and is none of the heights'.
        let Ok(text) = text.into_string() else {
            return Ok(found);
        };
        let Ok(document) = parse_xml(text.trim_end_matches('\0')) else {
            return Ok(found);
        };
        for item in document.descendants().filter(|node| node.has_tag_name("Item")) {
            let band = item.attribute("sample").unwrap_or("0").parse::<usize>().ok();
            let Some(band) = band.and_then(|band| found.get_mut(band)) else {
                continue;
            };
            let number = item.text().and_then(|text| text.trim().parse::<f64>().ok());
            match (item.attribute("role"), number.filter(|number| number.is_finite())) {
                (Some("scale"), Some(scale)) if scale != 0.0 => band.scale = scale,
                (Some("offset"), Some(offset)) => band.offset = offset,
                (Some("scale"), _) => {
                    return Err(Error::malformed("has a scale of its heights that is 0 or no number"));
                }
                (Some("offset"), _) => return Err(Error::malformed("has an offset of its heights that is no number")),
                _ => {}
            }
        }
        Ok(found)
    }

    fn height(self, value: f64) -> f64 {
        value * self.scale + self.offset
    }
}

/// Refuses a mask of the cells, which a further image of the file may be: they would be ground.
fn require_no_mask(image: &mut Image<'_>) -> Result<(), Error> {
    for _ in 1..IMAGES_MAX {
        // What is no image is none of the height model, whose own was read.
        if !image.more_images() || image.next_image().is_err() {
            break;
        }
        let kind: Option<u32> = image.find_tag_unsigned(Tag::NewSubfileType).map_err(wrong)?;
        if kind.is_some_and(|kind| kind & IS_MASK != 0) {
            return Err(Error::unsupported(
                "has a mask of its cells, which is not read; `gdalwarp -dstnodata -9999` writes cells without a height as \
                 such",
            ));
        }
    }
    Ok(())
}

/// Values as real numbers.
fn reals(values: DecodingResult) -> Result<Vec<f64>, Error> {
    Ok(match values {
        DecodingResult::U8(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::U16(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::U32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I8(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I16(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::I32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F32(values) => values.into_iter().map(f64::from).collect(),
        DecodingResult::F64(values) => values,
        _ => {
            return Err(Error::unsupported(
                "has values of 16-bit reals or 64-bit integers; `gdal_translate -ot Float32` changes them",
            ));
        }
    })
}

/// Where the cells lie.
struct Place {
    west: f64,
    north: f64,
    cell: [f64; 2],
    crs: Option<String>,
}

impl Place {
    fn of(image: &mut Image<'_>) -> Result<Self, Error> {
        let mut reals = |tag: Tag| -> Result<Option<Vec<f64>>, Error> {
            let value = image.find_tag(tag).map_err(wrong)?;
            value.map(|value| value.into_f64_vec().map_err(wrong)).transpose()
        };
        let scale = reals(Tag::ModelPixelScaleTag)?;
        let tie = reals(Tag::ModelTiepointTag)?;
        let matrix = reals(Tag::ModelTransformationTag)?;
        let (west, north, cell) = match (scale.as_deref(), tie.as_deref(), matrix.as_deref()) {
            (Some(&[dx, dy, ..]), Some(&[i, j, _, x, y, _]), _) => (x - i * dx, y + j * dy, [dx, dy]),
            (_, _, Some(&[dx, turn, _, x, skew, dy, _, y, ..])) if turn == 0.0 && skew == 0.0 => (x, y, [dx, -dy]),
            _ => {
                return Err(Error::unsupported(
                    "does not say where its cells lie, or they are turned; a height model is a GeoTIFF with north up \
                     (gdalwarp makes one)",
                ));
            }
        };
        let keys: Vec<u16> = image
            .find_tag_unsigned_vec(Tag::GeoKeyDirectoryTag)
            .map_err(wrong)?
            .unwrap_or_default();
        if cell[1] < 0.0 {
            return Err(Error::unsupported(
                "has its rows from south to north; a height model has north up: `gdalwarp IN.tif OUT.tif` turns it \
                 over",
            ));
        }
        if cell[0] < 0.0 {
            return Err(Error::unsupported(
                "has its columns from east to west; a height model has north up: `gdalwarp IN.tif OUT.tif` turns it \
                 over",
            ));
        }
        // A key, the tag of its value (0: here), a count, the value. The first four are the version.
        let value = |key: u16| {
            let found = keys
                .chunks_exact(4)
                .skip(1)
                .find(|entry| entry[0] == key && entry[1] == 0);
            found.map(|entry| entry[3])
        };
        if value(MODEL_TYPE) == Some(GEOGRAPHIC) {
            return Err(Error::unsupported(
                "has coordinates in degrees, and a scene has lengths; `gdalwarp -t_srs EPSG:N` puts it into a projected \
                 system",
            ));
        }
        // Then the tie is the middle of a cell.
        let middle = if value(RASTER_TYPE) == Some(IS_POINT) { 0.5 } else { 0.0 };
        Ok(Self {
            west: west - middle * cell[0],
            north: north + middle * cell[1],
            cell,
            crs: value(PROJECTED_CRS)
                .filter(|&code| code != USER_DEFINED)
                .map(|code| format!("EPSG:{code}")),
        })
    }
}
