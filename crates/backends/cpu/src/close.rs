//! A device's backend, with close hemicubes on the processor.

use crate::CpuBackend;
use hemicube_contract::backend::{
    BackendError, BackendInfo, Counters, Geometry, Hemicube, HemicubeBackend, Pass, Rays, RenderSettings, StageTimes,
};
use hemicube_contract::close::is_close;
use hemicube_contract::delta::DeltaTable;
use hemicube_contract::escaped::EscapedPixels;
use hemicube_contract::face::Items;
use hemicube_contract::row::RowBlock;
use std::sync::Arc;

/// Has the CPU backend draw the close hemicubes ([`hemicube_contract::close`]) of a backend that leaves them. Any other
/// backend is returned as it is. Rows stay those of one hemicube each, in order, whatever the batches; the version
/// names both arithmetics from `load` on.
#[must_use]
pub fn with_close(device: Box<dyn HemicubeBackend>) -> Box<dyn HemicubeBackend> {
    if !device.info().capabilities.leaves_close {
        return device;
    }
    let mut info = device.info().clone();
    info.capabilities.leaves_close = false;
    Box::new(Both {
        info,
        device,
        processor: CpuBackend::new(),
        geometry: None,
    })
}

struct Both {
    info: BackendInfo,
    device: Box<dyn HemicubeBackend>,
    processor: CpuBackend,
    geometry: Option<Arc<Geometry>>,
}

impl Both {
    fn loaded(&mut self, geometry: &Arc<Geometry>) {
        self.geometry = Some(Arc::clone(geometry));
        self.info.version = format!("{}+{}", self.device.info().version, self.processor.info().version);
    }

    /// Without a scene the device answers, with its error.
    fn is_close(&self, hemicube: &Hemicube) -> bool {
        self.geometry
            .as_ref()
            .is_some_and(|geometry| is_close(geometry, hemicube))
    }
}

impl HemicubeBackend for Both {
    fn info(&self) -> &BackendInfo {
        &self.info
    }

    fn load(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.device.load(geometry, settings)?;
        self.processor.load(geometry, settings)?;
        self.loaded(geometry);
        Ok(())
    }

    fn load_for_fractions(&mut self, geometry: &Arc<Geometry>, settings: RenderSettings) -> Result<(), BackendError> {
        self.device.load_for_fractions(geometry, settings)?;
        self.processor.load_for_fractions(geometry, settings)?;
        self.loaded(geometry);
        Ok(())
    }

    fn choices(&self) -> Vec<String> {
        let mut choices = self.device.choices();
        choices.push(format!(
            "hemicubes with a surface right before them are drawn on {}",
            self.processor.info().device
        ));
        choices
    }

    fn stage_times(&self) -> StageTimes {
        self.device.stage_times()
    }

    fn fork(&self) -> Result<Box<dyn HemicubeBackend>, BackendError> {
        Ok(Box::new(Self {
            info: self.info.clone(),
            device: self.device.fork()?,
            processor: self.processor.another()?,
            geometry: self.geometry.clone(),
        }))
    }

    fn rows(&mut self, hemicubes: &[Hemicube], out: &mut RowBlock) -> Result<Counters, BackendError> {
        let are_close: Vec<bool> = hemicubes.iter().map(|hemicube| self.is_close(hemicube)).collect();
        if !are_close.contains(&true) {
            return self.device.rows(hemicubes, out);
        }
        let those = |wanted: bool| {
            let pairs = hemicubes.iter().zip(&are_close);
            pairs
                .filter(move |&(_, &is_close)| is_close == wanted)
                .map(|(&hemicube, _)| hemicube)
        };
        let (open, close): (Vec<Hemicube>, Vec<Hemicube>) = (those(false).collect(), those(true).collect());
        let [mut by_device, mut by_processor] = [RowBlock::default(), RowBlock::default()];
        let mut counters = self.processor.rows(&close, &mut by_processor)?;
        if !open.is_empty() {
            counters += self.device.rows(&open, &mut by_device)?;
        }
        // Nobody else can check this once they are one block.
        if by_device.len() != open.len() {
            let text = format!("{} rows of {} hemicubes", by_device.len(), open.len());
            return Err(BackendError::Internal(text));
        }
        let (mut device_rows, mut processor_rows) = (0..by_device.len(), 0..by_processor.len());
        for is_close in are_close {
            let (block, rows) = if is_close {
                (&by_processor, &mut processor_rows)
            } else {
                (&by_device, &mut device_rows)
            };
            if let Some(row) = rows.next() {
                out.push_row(&block.row(row));
            }
        }
        Ok(counters)
    }

    fn items(&mut self, hemicube: &Hemicube) -> Result<Items, BackendError> {
        if self.is_close(hemicube) {
            self.processor.items(hemicube)
        } else {
            self.device.items(hemicube)
        }
    }

    fn pass(&mut self, pass: &Pass<'_>) -> Result<Items, BackendError> {
        self.device.pass(pass)
    }

    fn rays(&mut self, rays: &Rays<'_>) -> Result<Vec<u32>, BackendError> {
        self.device.rays(rays)
    }

    fn draws_once(&self) -> bool {
        self.device.draws_once()
    }

    fn rows_and_items(
        &mut self,
        hemicubes: &[Hemicube],
        out: &mut RowBlock,
        items: &mut Vec<Items>,
    ) -> Result<Counters, BackendError> {
        let mut counters = Counters::default();
        let mut left = hemicubes;
        // Runs of the device's and of the processor's hemicubes.
        while let Some(first) = left.first() {
            let is_close = self.is_close(first);
            let other = left.iter().position(|hemicube| self.is_close(hemicube) != is_close);
            let (run, others) = left.split_at(other.unwrap_or(left.len()));
            left = others;
            counters += if is_close {
                self.processor.rows_and_items(run, out, items)?
            } else {
                self.device.rows_and_items(run, out, items)?
            };
        }
        Ok(counters)
    }

    fn escaped(
        &mut self,
        hemicube: &Hemicube,
        table: &DeltaTable,
        out: &mut EscapedPixels,
    ) -> Result<(), BackendError> {
        if self.is_close(hemicube) {
            self.processor.escaped(hemicube, table, out)
        } else {
            self.device.escaped(hemicube, table, out)
        }
    }
}
