//! Gradients by the paths of their parameters.

use std::collections::BTreeMap;

use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::tensor::Tensor;

/// Collects the gradient of every weight by the weight's path.
struct GradientCollector {
    path: Vec<String>,
    gradients: GradientsParams,
    found: BTreeMap<String, Vec<f32>>,
}

impl ModuleVisitor for GradientCollector {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let path = self.path.join(".");
        let gradient = self.gradients.get::<D>(param.id);
        let gradient = gradient.unwrap_or_else(|| panic!("{path} has no gradient"));
        assert_eq!(gradient.dims(), param.val().dims(), "{path}");
        let numbers = gradient.try_into_vec_as().unwrap();
        self.found.insert(path, numbers);
    }
}

/// Returns the gradient of each weight of a network by the weight's path. Every weight has one.
pub fn by_path(network: &impl Module, gradients: GradientsParams) -> BTreeMap<String, Vec<f32>> {
    let mut collector = GradientCollector {
        path: Vec::new(),
        gradients,
        found: BTreeMap::new(),
    };
    network.visit(&mut collector);
    collector.found
}
