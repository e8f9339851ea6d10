//! A weather file of a place that there is not, with the sun of a clear day every day.

use std::f64::consts::TAU;

/// The hours of 2023 at 52.5° N, 13.4° E: direct light from 6:00 to 18:00, a sky of 280 K on average, air of 20 °C at
/// noon in summer.
pub fn epw() -> String {
    let mut text = String::from(
        "LOCATION,Nowhere,Region,XXX,Invented,000000,52.5,13.4,1.0,34.0\nDESIGN CONDITIONS,0\n\
         TYPICAL/EXTREME PERIODS,0\nGROUND TEMPERATURES,0\nHOLIDAYS/DAYLIGHT SAVINGS,No,0,0,0\nCOMMENTS 1,\n\
         COMMENTS 2,\nDATA PERIODS,1,1,Data,Sunday, 1/ 1,12/31\n",
    );
    let days = [31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    for (days, month) in days.into_iter().zip(1u32..) {
        for day in 1..=days {
            for hour in 1..=24u32 {
                let of_day = (TAU * (f64::from(hour) - 0.5 - 6.0) / 24.0).sin();
                let summer = -(TAU * (f64::from(month) - 0.5) / 12.0).cos();
                let dry = 10.0 + 6.0 * summer + 4.0 * of_day;
                let direct = (700.0 * of_day).max(0.0).round();
                let diffuse = (120.0 * of_day).max(0.0).round();
                let above = if direct > 0.0 { 1361 } else { 0 };
                text.push_str(&format!(
                    "2023,{month},{day},{hour},60,?9?9?9,{dry:.1},5.0,50,101000,0,{above},{:.0},0,{direct},{diffuse},\
                     0,0,0,0,180,2.5,5,5,9999,99999,9,999999999,0,0.1,0,88,0.2,0.0,0.0\n",
                    300.0 + 20.0 * of_day
                ));
            }
        }
    }
    text
}
