//! Devices that compute, and their names.

use std::fmt;
use std::str::FromStr;

use burn::tensor::{Device, DeviceKind, DeviceType};

/// The name of a device: `flex`, `wgpu`, `wgpu:cpu`, `cuda:0`.
///
/// The word before the colon is a backend, one of the features of this crate. After the colon stands the number of
/// a device, or `cpu` for a graphics driver that computes on the CPU. A name without a colon means the best device of
/// the backend: a discrete graphics processor comes before an integrated one, and a driver that computes on the CPU is
/// never taken.
///
/// ```
/// use lamogen::DeviceName;
///
/// let name: DeviceName = "flex".parse()?;
/// let device = name.open()?;
/// for offer in DeviceName::available() {
///     println!("{offer}");
/// }
/// # Ok::<(), lamogen::DeviceError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct DeviceName {
    backend: Backend,
    choice: DeviceChoice,
}

/// A backend of burn; it need not be part of this build.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Backend {
    Flex,
    NdArray,
    Wgpu,
    Vulkan,
    Cuda,
    Metal,
    Rocm,
}

/// Which device of a backend a name means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum DeviceChoice {
    /// The best device.
    Best,
    /// The graphics driver that computes on the CPU.
    Cpu,
    /// The device with this number, from 0, in the order of [`Backend::devices`].
    Number(usize),
}

/// Why a device cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// The text is not the name of a device.
    #[error(
        "no device is named `{name}`: expected one of flex, ndarray, wgpu, vulkan, cuda, metal, rocm, \
         alone or with a number (cuda:0); with :cpu, wgpu and vulkan compute on the CPU (wgpu:cpu)"
    )]
    #[allow(missing_docs)]
    Name { name: String },
    /// The backend is not part of this build.
    #[error(
        "`{name}` needs lamogen's feature `{feature}`, which this program was built without; \
         it was built with: {built}"
    )]
    #[allow(missing_docs)]
    NotBuilt {
        name: DeviceName,
        feature: &'static str,
        built: String,
    },
    /// This machine has no such device.
    #[error("this machine has no device `{name}`; it offers: {offered}")]
    #[allow(missing_docs)]
    NotFound { name: DeviceName, offered: String },
}

impl Backend {
    const ALL: [Backend; 7] = [
        Backend::Flex,
        Backend::NdArray,
        Backend::Wgpu,
        Backend::Vulkan,
        Backend::Cuda,
        Backend::Metal,
        Backend::Rocm,
    ];

    /// Returns the name of the backend, which is also the name of its feature.
    fn name(self) -> &'static str {
        match self {
            Backend::Flex => "flex",
            Backend::NdArray => "ndarray",
            Backend::Wgpu => "wgpu",
            Backend::Vulkan => "vulkan",
            Backend::Cuda => "cuda",
            Backend::Metal => "metal",
            Backend::Rocm => "rocm",
        }
    }

    /// Whether the backend uses graphics drivers, among which may be one that computes on the CPU.
    fn is_graphics(self) -> bool {
        matches!(self, Backend::Wgpu | Backend::Vulkan)
    }

    /// Returns the type that burn has for the backend, or `None` if the backend is not part of this build.
    fn device_type(self) -> Option<DeviceType> {
        match self {
            #[cfg(feature = "flex")]
            Backend::Flex => Some(DeviceType::Flex),
            #[cfg(feature = "ndarray")]
            Backend::NdArray => Some(DeviceType::NdArray),
            #[cfg(feature = "wgpu")]
            Backend::Wgpu => Some(DeviceType::Wgpu),
            #[cfg(feature = "vulkan")]
            Backend::Vulkan => Some(DeviceType::Vulkan),
            #[cfg(feature = "cuda")]
            Backend::Cuda => Some(DeviceType::Cuda),
            #[cfg(feature = "metal")]
            Backend::Metal => Some(DeviceType::Metal),
            #[cfg(feature = "rocm")]
            Backend::Rocm => Some(DeviceType::Rocm),
            #[allow(unreachable_patterns)]
            _ => None,
        }
    }

    /// Returns the graphics device of a kind, or `None` if the backend does not use graphics drivers.
    #[cfg_attr(
        not(any(feature = "wgpu", feature = "vulkan")),
        allow(unused_variables)
    )]
    fn graphics_device(self, kind: DeviceKind) -> Option<Device> {
        match self {
            #[cfg(feature = "wgpu")]
            Backend::Wgpu => Some(Device::wgpu(kind)),
            #[cfg(feature = "vulkan")]
            Backend::Vulkan => Some(Device::vulkan(kind)),
            #[allow(unreachable_patterns)]
            _ => None,
        }
    }

    /// Returns the place of a device in the order of quality: discrete graphics processors come first, then integrated
    /// ones, then virtual ones.
    fn rank(self, device: &Device) -> usize {
        /// An upper bound: no machine has more devices of one kind.
        const MAX_DEVICES: usize = 64;
        let kinds: [fn(usize) -> DeviceKind; 3] = [
            DeviceKind::DiscreteGpu,
            DeviceKind::IntegratedGpu,
            DeviceKind::VirtualGpu,
        ];
        let all = kinds
            .into_iter()
            .flat_map(|kind| (0..MAX_DEVICES).map(kind));
        let mut ranked = all.map(|kind| self.graphics_device(kind));
        ranked
            .position(|ranked| ranked.as_ref() == Some(device))
            .unwrap_or(usize::MAX)
    }

    /// Returns the devices of this backend on this machine, best first, and separately the graphics driver that
    /// computes on the CPU, if there is one.
    fn devices(self) -> (Vec<Device>, Option<Device>) {
        let Some(device_type) = self.device_type() else {
            return (Vec::new(), None);
        };
        let mut all = Device::enumerate(device_type).into_vec();
        let software = self.graphics_device(DeviceKind::Cpu);
        if self.is_graphics() {
            // burn lists the devices of some drivers in the order of the driver.
            all.sort_by_key(|device| self.rank(device));
        }
        let place = all
            .iter()
            .position(|device| Some(device) == software.as_ref());
        let software = place.map(|place| all.remove(place));
        (all, software)
    }
}

impl DeviceName {
    /// Returns the names of the devices that this build can use and this machine has.
    pub fn available() -> Vec<DeviceName> {
        let mut names = Vec::new();
        for backend in Backend::ALL {
            let (devices, software) = backend.devices();
            let is_single = devices.len() == 1;
            names.extend((0..devices.len()).map(|number| DeviceName {
                backend,
                choice: match is_single {
                    true => DeviceChoice::Best,
                    false => DeviceChoice::Number(number),
                },
            }));
            names.extend(software.map(|_| DeviceName {
                backend,
                choice: DeviceChoice::Cpu,
            }));
        }
        names
    }

    /// Opens the device of this name.
    ///
    /// # Errors
    ///
    /// If this program was built without the backend, or this machine has no such device.
    pub fn open(self) -> Result<Device, DeviceError> {
        if self.backend.device_type().is_none() {
            let built = Backend::ALL.into_iter();
            let built = built.filter(|backend| backend.device_type().is_some());
            return Err(DeviceError::NotBuilt {
                name: self,
                feature: self.backend.name(),
                built: join_names(built.map(Backend::name)),
            });
        }
        let (devices, software) = self.backend.devices();
        let device = match self.choice {
            DeviceChoice::Best => devices.into_iter().next(),
            DeviceChoice::Number(number) => devices.into_iter().nth(number),
            DeviceChoice::Cpu => software,
        };
        device.ok_or_else(|| DeviceError::NotFound {
            name: self,
            offered: join_names(DeviceName::available()),
        })
    }
}

/// Joins names by commas for an error message.
fn join_names(names: impl IntoIterator<Item = impl ToString>) -> String {
    let names: Vec<String> = names.into_iter().map(|name| name.to_string()).collect();
    match names.is_empty() {
        true => "nothing".into(),
        false => names.join(", "),
    }
}

impl FromStr for DeviceName {
    type Err = DeviceError;

    fn from_str(name: &str) -> Result<Self, DeviceError> {
        let error = || DeviceError::Name { name: name.into() };
        let (backend, choice) = match name.split_once(':') {
            None => (name, None),
            Some((backend, choice)) => (backend, Some(choice)),
        };
        let backend = Backend::ALL
            .into_iter()
            .find(|known| known.name() == backend)
            .ok_or_else(error)?;
        let choice = match choice {
            None => DeviceChoice::Best,
            Some("cpu") if backend.is_graphics() => DeviceChoice::Cpu,
            Some(number) => DeviceChoice::Number(number.parse().map_err(|_| error())?),
        };
        Ok(DeviceName { backend, choice })
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.backend.name())?;
        match self.choice {
            DeviceChoice::Best => Ok(()),
            DeviceChoice::Cpu => f.write_str(":cpu"),
            DeviceChoice::Number(number) => write!(f, ":{number}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in [
            "flex",
            "ndarray",
            "wgpu",
            "wgpu:cpu",
            "vulkan:cpu",
            "cuda:0",
            "metal:3",
        ] {
            assert_eq!(name.parse::<DeviceName>().unwrap().to_string(), name);
        }
    }

    #[test]
    fn errors_of_unknown_names_list_the_known_ones() {
        for name in [
            "", "gpu", "cuda:", "cuda:one", "flex:cpu", "wgpu:-1", "Flex",
        ] {
            let message = name.parse::<DeviceName>().unwrap_err().to_string();
            assert!(message.contains(&format!("`{name}`")), "{message}");
            assert!(message.contains("flex, ndarray, wgpu"), "{message}");
        }
    }

    #[cfg(feature = "flex")]
    #[test]
    fn there_is_exactly_one_flex_device() {
        let flex: DeviceName = "flex".parse().unwrap();
        assert!(DeviceName::available().contains(&flex));
        assert_eq!(flex.open().unwrap(), Device::flex());
        let message = "flex:1".parse::<DeviceName>().unwrap().open().unwrap_err();
        assert!(
            message.to_string().contains("no device `flex:1`"),
            "{message}"
        );
        assert!(message.to_string().contains("offers: flex"), "{message}");
    }

    #[cfg(not(feature = "rocm"))]
    #[test]
    fn the_error_of_a_missing_backend_names_its_feature() {
        let name: DeviceName = "rocm:0".parse().unwrap();
        let message = name.open().unwrap_err().to_string();
        assert!(message.contains("feature `rocm`"), "{message}");
        assert!(message.contains("built with: "), "{message}");
    }
}
