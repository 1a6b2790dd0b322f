//! Where to compute, named by a word.

use std::fmt;
use std::str::FromStr;

use burn::tensor::{Device, DeviceKind, DeviceType};

/// A device by its name: `flex`, `wgpu`, `wgpu:cpu`, `cuda:0`.
///
/// Before the colon stands a backend, one of the features of this crate. After it stands the number of
/// a device, or `cpu` for a graphics driver that computes on the CPU; without it the backend's best device is
/// meant, a graphics processor of its own before one beside the CPU, and never such a driver.
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
    which: Which,
}

/// A backend of burn. Whether it is part of this build is another matter.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Which {
    Best,
    Cpu,
    Number(usize),
}

/// A device that there is not.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceError {
    /// The word is no name of a device.
    #[error(
        "no device is named `{name}`: expected one of flex, ndarray, wgpu, vulkan, cuda, metal, rocm, \
         alone or with a number (cuda:0); with :cpu, wgpu and vulkan compute on the CPU (wgpu:cpu)"
    )]
    #[allow(missing_docs)]
    Name { name: String },
    /// The backend is no part of this build.
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

    fn word(self) -> &'static str {
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

    /// Whether a graphics driver may stand behind it that computes on the CPU.
    fn is_graphics(self) -> bool {
        matches!(self, Backend::Wgpu | Backend::Vulkan)
    }

    /// What burn calls it; `None` if it is no part of this build.
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

    /// The graphics device of a kind.
    #[cfg_attr(
        not(any(feature = "wgpu", feature = "vulkan")),
        allow(unused_variables)
    )]
    fn graphics(self, kind: DeviceKind) -> Option<Device> {
        match self {
            #[cfg(feature = "wgpu")]
            Backend::Wgpu => Some(Device::wgpu(kind)),
            #[cfg(feature = "vulkan")]
            Backend::Vulkan => Some(Device::vulkan(kind)),
            #[allow(unreachable_patterns)]
            _ => None,
        }
    }

    /// Graphics processors of their own first, then those beside the CPU, then virtual ones.
    fn rank(self, device: &Device) -> usize {
        /// More devices of a kind than any machine has.
        const MOST: usize = 64;
        let kinds: [fn(usize) -> DeviceKind; 3] = [
            DeviceKind::DiscreteGpu,
            DeviceKind::IntegratedGpu,
            DeviceKind::VirtualGpu,
        ];
        let all = kinds.into_iter().flat_map(|kind| (0..MOST).map(kind));
        let mut named = all.map(|kind| self.graphics(kind));
        named
            .position(|named| named.as_ref() == Some(device))
            .unwrap_or(usize::MAX)
    }

    /// The devices of this backend that this machine has, best first; those that are a CPU in disguise apart.
    fn devices(self) -> (Vec<Device>, Option<Device>) {
        let Some(device_type) = self.device_type() else {
            return (Vec::new(), None);
        };
        let mut all = Device::enumerate(device_type).into_vec();
        let software = self.graphics(DeviceKind::Cpu);
        if self.is_graphics() {
            // burn lists some drivers' devices as the driver does.
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
    /// The devices that this build can use and this machine has, each under its name.
    pub fn available() -> Vec<DeviceName> {
        let mut names = Vec::new();
        for backend in Backend::ALL {
            let (devices, software) = backend.devices();
            let alone = devices.len() == 1;
            names.extend((0..devices.len()).map(|number| DeviceName {
                backend,
                which: match alone {
                    true => Which::Best,
                    false => Which::Number(number),
                },
            }));
            names.extend(software.map(|_| DeviceName {
                backend,
                which: Which::Cpu,
            }));
        }
        names
    }

    /// The device of this name.
    ///
    /// # Errors
    ///
    /// If this program was built without its backend, or this machine has no such device.
    pub fn open(self) -> Result<Device, DeviceError> {
        if self.backend.device_type().is_none() {
            let built = Backend::ALL.into_iter();
            let built = built.filter(|backend| backend.device_type().is_some());
            return Err(DeviceError::NotBuilt {
                name: self,
                feature: self.backend.word(),
                built: list(built.map(Backend::word)),
            });
        }
        let (devices, software) = self.backend.devices();
        let device = match self.which {
            Which::Best => devices.into_iter().next(),
            Which::Number(number) => devices.into_iter().nth(number),
            Which::Cpu => software,
        };
        device.ok_or_else(|| DeviceError::NotFound {
            name: self,
            offered: list(DeviceName::available()),
        })
    }
}

fn list(items: impl IntoIterator<Item = impl ToString>) -> String {
    let items: Vec<String> = items.into_iter().map(|item| item.to_string()).collect();
    match items.is_empty() {
        true => "nothing".into(),
        false => items.join(", "),
    }
}

impl FromStr for DeviceName {
    type Err = DeviceError;

    fn from_str(name: &str) -> Result<Self, DeviceError> {
        let error = || DeviceError::Name { name: name.into() };
        let (word, which) = match name.split_once(':') {
            None => (name, None),
            Some((word, which)) => (word, Some(which)),
        };
        let backend = Backend::ALL
            .into_iter()
            .find(|backend| backend.word() == word)
            .ok_or_else(error)?;
        let which = match which {
            None => Which::Best,
            Some("cpu") if backend.is_graphics() => Which::Cpu,
            Some(number) => Which::Number(number.parse().map_err(|_| error())?),
        };
        Ok(DeviceName { backend, which })
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.backend.word())?;
        match self.which {
            Which::Best => Ok(()),
            Which::Cpu => f.write_str(":cpu"),
            Which::Number(number) => write!(f, ":{number}"),
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
    fn what_is_no_name_is_answered_with_those_that_are() {
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
    fn flex_is_always_there_and_only_once() {
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
    fn a_backend_that_was_left_out_names_its_feature() {
        let name: DeviceName = "rocm:0".parse().unwrap();
        let message = name.open().unwrap_err().to_string();
        assert!(message.contains("feature `rocm`"), "{message}");
        assert!(message.contains("built with: "), "{message}");
    }
}
