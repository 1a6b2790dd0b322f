//! temp
use burn::tensor::*;
use lamogen_guide::*; use lamogen_laban::*; use lamogen_model::*; use lamogen_motion::*;
use std::ops::ControlFlow;
fn main(){
 let folder=std::path::PathBuf::from(std::env::args().nth(1).unwrap());
 let device=Device::flex();
 let bytes=std::fs::read(folder.join("case.safetensors")).unwrap();
 let st=safetensors::SafeTensors::deserialize(&bytes).unwrap();
 let f=|n:&str|{let v=st.tensor(n).unwrap(); TensorData::new(v.data().chunks_exact(4).map(|b|f32::from_le_bytes(b.try_into().unwrap())).collect::<Vec<f32>>(), v.shape().to_vec())};
 let i=|n:&str|{let v=st.tensor(n).unwrap(); (v.data().chunks_exact(8).map(|b|i64::from_le_bytes(b.try_into().unwrap()) as i32).collect::<Vec<i32>>(), v.shape().to_vec())};
 let config=ModelConfig::from_file(folder.join("config.json")).unwrap();
 let model=Checkpoint::open(folder.join("latest.tar")).unwrap().load(&config,&device).unwrap();
 let nz=Normalization::from_files(folder.join("mean.npy"),folder.join("std.npy"),config.input_feats,&device).unwrap();
 let (t,s)=i("in.tokens"); let tokens=Tensor::<2,Int>::from_data(TensorData::new(t,s),&device);
 let lengths:Vec<usize>=i("in.lengths").0.iter().map(|&x|x as usize).collect();
 let sc:Vec<f32>=f("in.scale").try_to_vec().unwrap(); let scale=Scale::new(sc.try_into().unwrap()).unwrap();
 let batch=Batch{prompt:model.encode(tokens),noise:Tensor::from_data(f("in.z"),&device),lengths:lengths.clone()};
 let steps=i("out.timesteps").0.len();
 let sampler=Sampler::new(&model,&nz,steps).unwrap();
 let base=Tensor::<3>::from_data(f("out.baseline"),&device);
 let save=|n:&str,v:Vec<f32>|{let l=v.len(); npy::write(format!("/tmp/d_{n}.npy"),&v,&[l]).unwrap();};
 let (e,text)=model.encode_text(Tensor::<2,Int>::from_data({let (t,s)=i("in.tokens");TensorData::new(t,s)},&device)); save("e",e.to_data().try_to_vec().unwrap()); save("text",text.to_data().try_to_vec().unwrap());
 let ts:Vec<usize>=i("in.t").0.iter().map(|&x|x as usize).collect(); let pr=batch.prompt.clone();
 let xt=Tensor::<3>::from_data(f("in.x_t"),&device); save("temb",model.embed_timesteps(&ts).to_data().try_to_vec().unwrap());
 save("eps",model.denoise(DenoiserInput{x_t:xt.clone(),time:model.embed_timesteps(&ts),embedding:pr.embedding.clone(),mask:FrameMask::new(&lengths,xt.dims()[1],&device)},&pr.context).to_data().try_to_vec().unwrap());
 let mut first=true;
 sampler.guided(&batch,base.clone(),&vec![scale;lengths.len()],&Guidance::paper(),&mut |st:&Step<'_>|{ if first {save("g",st.gradient.unwrap().to_data().try_to_vec().unwrap());} first=false; ControlFlow::Continue(())}).unwrap();
 let mut first=true; let z=Guidance{learning_rate:0.0,..Guidance::paper()};
 sampler.guided(&batch,base.clone(),&vec![scale;lengths.len()],&z,&mut |st:&Step<'_>|{ if first {
   save("x0",st.prediction.to_data().try_to_vec().unwrap());
   let j=joints(nz.denormalize(st.prediction.clone())); save("j",j.to_data().try_to_vec().unwrap());
   let ff=LabanFeatures::new(&LabanOptions::default(),base.dims()[1],&lengths,&device); save("f",ff.measure(j).to_data().try_to_vec().unwrap());
   save("fb",ff.measure(joints(nz.denormalize(base.clone()))).to_data().try_to_vec().unwrap());
 } first=false; ControlFlow::Continue(())}).unwrap();
}
