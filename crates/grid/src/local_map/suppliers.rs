//! Which keyframe stands behind each cell. That alone of a local map depends on the order in which it was drawn; all else is a
//! function of what is drawn where.

use super::{LocalMap, NO_SUPPLIER};

impl LocalMap {
    /// The keyframe behind each cell with hits, row by row; none where it was taken out since.
    #[must_use]
    pub fn suppliers(&self) -> Vec<Option<u32>> {
        let supplier = |slot: u32| self.suppliers[slot as usize];
        self.slots_row_by_row().into_iter().map(|slot| Some(supplier(slot)).filter(|&s| s != NO_SUPPLIER)).collect()
    }

    /// Puts the keyframes behind the cells that [`LocalMap::suppliers`] has told of a map in which the same is drawn; false
    /// where these are not as many cells.
    pub fn set_suppliers(&mut self, suppliers: &[Option<u32>]) -> bool {
        let slots = self.slots_row_by_row();
        if slots.len() != suppliers.len() {
            return false;
        }
        for (slot, supplier) in slots.into_iter().zip(suppliers) {
            self.suppliers[slot as usize] = supplier.unwrap_or(NO_SUPPLIER);
        }
        true
    }

    fn slots_row_by_row(&self) -> Vec<u32> {
        let slots = 0..self.counts.slot_count() as u32;
        let mut cells: Vec<_> = slots.map(|slot| (*self.counts.cell(slot), slot)).collect();
        cells.retain(|(cell, _)| cell.hits > 0);
        cells.sort_unstable_by_key(|(cell, _)| (cell.y, cell.x));
        cells.into_iter().map(|(_, slot)| slot).collect()
    }
}
