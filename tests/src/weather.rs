//! Weather files of places that there are not, with the sun of a clear day every day.

use std::f64::consts::TAU;

/// A place and its year.
#[derive(Clone, Copy, Debug)]
pub struct Climate {
    /// For messages.
    pub name: &'static str,
    /// Degrees north.
    pub latitude: f64,
    /// Degrees east.
    pub longitude: f64,
    /// Hours before UTC.
    pub zone: f64,
    /// Metres above the sea.
    pub elevation: f64,
    /// Mean temperature of the air, °C.
    pub mean: f64,
    /// How much warmer June is, K.
    pub june: f64,
    /// Direct irradiance across the beam at noon, W/m².
    pub direct: f64,
    /// Diffuse irradiance of level ground at noon, W/m².
    pub diffuse: f64,
    /// Relative humidity, %.
    pub humidity: u32,
}

/// The city of [`epw`].
pub const TEMPERATE: Climate = Climate {
    name: "temperate",
    latitude: 52.5,
    longitude: 13.4,
    zone: 1.0,
    elevation: 34.0,
    mean: 10.0,
    june: 6.0,
    direct: 700.0,
    diffuse: 120.0,
    humidity: 50,
};

/// Tropics, the far north, and a desert in the south.
pub const CLIMATES: [Climate; 3] = [
    Climate {
        name: "tropics",
        latitude: 1.4,
        longitude: 104.0,
        zone: 8.0,
        elevation: 15.0,
        mean: 27.0,
        june: 1.0,
        direct: 500.0,
        diffuse: 300.0,
        humidity: 85,
    },
    Climate {
        name: "north",
        latitude: 64.8,
        longitude: -147.7,
        zone: -9.0,
        elevation: 136.0,
        mean: -2.0,
        june: 18.0,
        direct: 800.0,
        diffuse: 80.0,
        humidity: 65,
    },
    Climate {
        name: "desert",
        latitude: -23.8,
        longitude: 133.9,
        zone: 9.5,
        elevation: 546.0,
        mean: 21.0,
        june: -9.0,
        direct: 950.0,
        diffuse: 60.0,
        humidity: 25,
    },
];

/// The hours of 2023 at 52.5° N, 13.4° E: direct light from 6:00 to 18:00, a sky of 280 K on average, air of 20 °C at
/// noon in summer.
pub fn epw() -> String {
    TEMPERATE.epw()
}

impl Climate {
    /// Its hours of 2023.
    pub fn epw(&self) -> String {
        let Self {
            latitude,
            longitude,
            zone,
            elevation,
            humidity,
            ..
        } = self;
        let mut text = format!(
            "LOCATION,Nowhere,Region,XXX,Invented,000000,{latitude},{longitude},{zone:.1},{elevation:.1}\nDESIGN CONDITIONS,0\n\
         TYPICAL/EXTREME PERIODS,0\nGROUND TEMPERATURES,0\nHOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\nCOMMENTS 1,\n\
         COMMENTS 2,\nDATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n",
        );
        let days = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
        for (days, month) in days.into_iter().zip(1u32..) {
            for day in 1..=days {
                for hour in 1..=24u32 {
                    let of_day = (TAU * (f64::from(hour) - 0.5 - 6.0) / 24.0).sin();
                    let summer = -(TAU * (f64::from(month) - 0.5) / 12.0).cos();
                    let dry = self.mean + self.june * summer + 4.0 * of_day;
                    let direct = (self.direct * of_day).max(0.0).round();
                    let diffuse = (self.diffuse * of_day).max(0.0).round();
                    let above = if direct > 0.0 { 1361 } else { 0 };
                    text.push_str(&format!(
                    "2023,{month},{day},{hour},60,?9?9?9,{dry:.1},5.0,{humidity},101000,0,{above},{:.0},0,{direct},{diffuse},\
                     0,0,0,0,180,2.5,5,5,9999,99999,9,999999999,0,0.1,0,88,0.2,0.0,0.0\n",
                    300.0 + 20.0 * of_day
                ));
                }
            }
        }
        text
    }
}
