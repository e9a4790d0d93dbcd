//! Renderers that are kept from picture to picture: to link their shaders, and to make pipelines and textures, takes longer than
//! many a picture.

use std::{
    any::Any,
    sync::{Arc, Mutex, PoisonError},
};

use anyhow::Result;

/// As many as are used in turns: one for small pictures while the camera moves, and one for whole ones.
const MOST: usize = 2;

/// Renderers by what they were made of; the one that was used last comes last.
#[derive(Default)]
pub(crate) struct Kept(Mutex<Vec<Box<dyn Any + Send>>>);

impl Kept {
    /// The renderer that was made of this, or a new one.
    pub(crate) fn get<K, T>(&self, of: K, make: impl FnOnce() -> Result<T>) -> Result<Arc<T>>
    where
        K: PartialEq + Send + 'static,
        T: Send + Sync + 'static,
    {
        // Whoever panicked has put in or taken out whole ones.
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let own = |one: &Box<dyn Any + Send>| {
            let (key, renderer) = one.downcast_ref::<(K, Arc<T>)>()?;
            (*key == of).then(|| renderer.clone())
        };
        let found = all.iter().enumerate();
        let found = found.filter_map(|(at, one)| Some((at, own(one)?))).next();
        let renderer = match found {
            Some((at, renderer)) => {
                all.remove(at);
                renderer
            }
            None => {
                // Before there is a new one: their textures can be large.
                if all.len() == MOST {
                    all.remove(0);
                }
                Arc::new(make()?)
            }
        };
        all.push(Box::new((of, renderer.clone())));
        Ok(renderer)
    }
}

#[cfg(test)]
mod tests {
    use anyhow::bail;

    use super::*;

    #[test]
    fn the_last_two_are_kept() {
        let kept = Kept::default();
        let get = |key: u32| {
            let mut is_new = false;
            let made = kept.get(key, || {
                is_new = true;
                Ok(format!("{key}"))
            });
            assert_eq!(*made.unwrap(), key.to_string());
            is_new
        };
        assert_eq!([1, 1, 2, 1, 2].map(get), [true, false, true, false, false]);
        // 1 was used less lately than 2.
        assert_eq!([3, 2, 1].map(get), [true, false, true]);
        // What is made of the same but is something else is not the same.
        assert_eq!(*kept.get(2_u32, || Ok(7_u8)).unwrap(), 7);
        assert!(kept.get::<_, u8>(9_u32, || bail!("no")).is_err());
    }
}
