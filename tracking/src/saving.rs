//! How shared parts of features are saved: by their values.

/// Values that are shared; each is saved where it is used.
pub(crate) mod shared {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<T: Serialize, S: Serializer>(
        value: &Option<Arc<T>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        value.as_deref().serialize(serializer)
    }

    pub(crate) fn deserialize<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<Arc<T>>, D::Error> {
        Ok(Option::<T>::deserialize(deserializer)?.map(Arc::new))
    }
}

/// The images around features.
pub(crate) mod patches {
    use std::sync::Arc;

    use linecarve_points::Patch;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};

    pub(crate) fn serialize<S: Serializer>(
        patches: &[Option<Arc<Patch>>],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let samples = |patch: &Option<Arc<Patch>>| patch.as_ref().map(|patch| patch.to_vec());
        serializer.collect_seq(patches.iter().map(samples))
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<Option<Arc<Patch>>>, D::Error> {
        let known = Vec::<Option<Vec<u8>>>::deserialize(deserializer)?;
        let patch = |samples: Vec<u8>| {
            let patch = Patch::try_from(samples);
            patch.map(Arc::new).map_err(|samples| {
                D::Error::invalid_length(samples.len(), &"the samples of a patch")
            })
        };
        let patches = known
            .into_iter()
            .map(|samples| samples.map(patch).transpose());
        patches.collect()
    }
}
